"""What a reader looks at: figures of a study, its page, and its report."""
