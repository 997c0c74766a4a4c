"""What leaves the framework: a bundle holds everything that is needed to answer on new recordings.

Contract: a bundle is a folder that `bundle.write` publishes and `bundle.read` checks before anything uses it.
To add an artefact, add a file here with a function of a `Bundle`, and name its file in bundle.json.
"""
