"""C99 of a trained classifier: what it holds (`plan`, `counting`), its text (`code`, `files`), runs (`host`).

Contract: `counting.code_of` returns the `Code` of a bundle, or raises `Unsupported` with the reason;
`files.write` writes it. Both need the bundle alone, neither recordings nor a compiler. Templates walk the
code: its layers, encoder and variables. To add a kind of classifier, extend `Code` and write a template.
"""
