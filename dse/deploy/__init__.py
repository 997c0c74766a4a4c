"""What leaves the framework: a bundle holds everything that is needed to answer on new recordings.

Contract: a bundle is a folder that `bundle.write` publishes and `bundle.read` checks before anything uses it.
`form` says in whole numbers what runs, and every target (dse.deploy.targets) walks it: one file each. `run`
compares what a target did with the bundle's own engine (`reference`), the same for all.
"""
