"""C99 of a trained network: what it must do (`plan`), its text (`source`), and running it here (`host`).

Contract: `plan.plan_of` returns all that the C of a bundle needs, or raises `Unsupported` with the reason.
`source.write` writes the files. Both need the bundle alone, neither recordings nor a compiler.
"""
