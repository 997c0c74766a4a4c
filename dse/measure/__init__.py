"""What a trained design measures: one run, the decision maker, heads of joint targets, and objectives."""
