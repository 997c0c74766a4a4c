"""The C of `c99` for Cortex-M processors: cross-compiled, and executed in an emulator (`emulator`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dse.config.resolved import Sections
from dse.dataset.shape import Shape
from dse.deploy.bundle import Bundle
from dse.deploy.c import code_size
from dse.deploy.c.code import Code
from dse.deploy.c.counting import code_of
from dse.deploy.c.least import FLASH, RAM, least_memory
from dse.deploy.form import Unsupported
from dse.deploy.prefix import prefixed
from dse.deploy.targets.emulated import Emulated
from dse.deploy.targets.emulator import MOST_FLASH_BYTES, Core
from dse.deploy.targets.thumb import CORES
from dse.hardware.profile import load
from dse.registry import Column, register


class CortexM(Emulated):
    """The target of one core.

    core: which; its row in `thumb.CORES` is all that differs.
    profile: hardware profile that predicts its cycles; '' for none.
    """

    profile: ClassVar[str]
    known_before: ClassVar[tuple[Column, ...]] = (RAM, FLASH)
    use: ClassVar[str] = "compile `src/dse.c` there with your firmware; README.md beside it has the flags"

    @property
    def code_bytes(self) -> Mapping[str, float]:
        """Bytes of the parts of the code (dse.deploy.c.code_size)."""
        return code_size.CORTEX_M0_PLUS if self.core is CORES["cortex_m0plus"] else code_size.CORTEX_M

    def form(self, bundle: Bundle) -> Code:
        """Return the classifier as C holds it, if it fits into the flash."""
        plan = code_of(bundle)
        chip, flash = "the emulator", MOST_FLASH_BYTES
        if self.profile:
            flash_kib = load(self.profile).at("value")["flash_kib"]
            chip, flash = f"the chip of profile {self.profile}", int(flash_kib) * 1024
        if (n := int(code_size.flash_bytes(plan, self.code_bytes))) > flash:
            raise Unsupported(f"it takes {n} bytes of flash, and {chip} has {flash}")
        return plan

    def footprint(self, bundle: Bundle) -> dict[str, float]:
        """Return its memory before it is written: in flash constants exactly, code from measured parts."""
        plan = code_of(bundle)
        return code_size.footprint(plan) | {"flash_bytes": code_size.flash_bytes(plan, self.code_bytes)}

    def least_footprint(self, sections: Sections, shape: Shape) -> dict[str, tuple[float, float]]:
        """Return its memory before a design is trained (`dse.deploy.c.least`)."""
        return least_memory(sections, shape, self.code_bytes)

    def emit(self, form: Code, bundle: Bundle, folder: Path) -> None:
        """Write the files of `c99`, and how they are compiled for the core."""
        super().emit(form, bundle, folder)
        readme = folder / "README.md"
        text = readme.read_text(encoding="utf-8") + prefixed(_readme(self.core), bundle.prefix)
        readme.write_text(text, encoding="utf-8")


def _target(core: Core) -> type[CortexM]:
    """Return the target of a core."""
    doc = f"The C of c99, executed in an emulator{core.note}."
    members = {
        "__doc__": doc,
        "__module__": __name__,
        "core": core,
        "label": core.label,
        "profile": core.profile,
    }
    return dataclass(frozen=True)(type(core.label.replace("-", "").replace("+", "Plus"), (CortexM,), members))


TARGETS = {name: register("targets", name)(_target(core)) for name, core in CORES.items()}
"""Name -> target of every core."""
globals().update({cls.__name__: cls for cls in TARGETS.values()})  # where pickle looks for classes


def _readme(core: Core) -> str:
    return f"""
## {core.label}

`src/dse.c` needs neither a library nor an operating system: add it and `src/dse.h` to the firmware.
`dse verify` executes it in an emulator, compiled by

    python -m ziglang cc {" ".join(core.options)} -c src/dse.c
"""
