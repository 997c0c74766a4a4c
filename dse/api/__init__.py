"""What the command line and Python share: to choose among design points, and a study as notebooks use it.

study = dse.run("quickstart")                                  or a YAML file, or a dict of its sections
study.best("n_weights <= 5000", hardware="loihi1_silicon")     a design point
study.skyline(where="accuracy >= 0.8", confidence=0.5)
study.plot.front()
"""
