"""How long tests wait for something that must happen: as long as a busy machine may need."""

import time

PATIENCE_S = 300.0
PATIENCE_MS = 1000 * PATIENCE_S


def until(condition, what):
    """Wait until a condition holds; a failure names what was waited for."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"waited {PATIENCE_S:.0f} s in vain: {what}"
        time.sleep(0.005)
