"""What a disk, a crash or a person does to a file, drawn from a seed."""

import shutil


def _flip(content, rng):
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)


def _digit(content, rng):
    places = [i for i, byte in enumerate(content) if 48 <= byte <= 57]
    if places:
        place = rng.choice(places)
        content[place] = rng.choice([byte for byte in range(48, 58) if byte != content[place]])


def _cut(content, rng):
    del content[rng.randrange(len(content)) :]


def _zero(content, rng):
    place = rng.randrange(len(content))
    block = content[place : place + 512]
    content[place : place + 512] = bytes(len(block))


def _double(content, rng):
    lines = bytes(content).splitlines(keepends=True)
    place = rng.randrange(len(lines))
    content[:] = b"".join([*lines[: place + 1], *lines[place:]])


def _drop(content, rng):
    lines = bytes(content).splitlines(keepends=True)
    del lines[rng.randrange(len(lines))]
    content[:] = b"".join(lines)


INSIDE = {
    "flip": _flip, "digit": _digit, "cut": _cut, "zero": _zero, "double": _double, "drop": _drop,
}  # fmt: skip


def damage(path, rng, foreign=None):
    """Damage a file; return how. `foreign`: the same file of another study of the same name."""
    from_another = ["foreign"] * 2 if foreign is not None and foreign.is_file() else []
    kind = rng.choice([*INSIDE, *INSIDE, "remove", "empty", "swap", "null", *from_another])
    if kind in INSIDE:
        content = bytearray(path.read_bytes())
        if content:
            INSIDE[kind](content, rng)
        path.write_bytes(content)
    elif kind == "foreign" and foreign is not None:
        shutil.copy(foreign, path)
    elif kind == "remove":
        path.unlink()
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "null":
        path.write_text(rng.choice(("null", "[]", "{}", "3\n", "~\n")))
    else:
        # another run of the study, or a file of another entry of the cache
        is_run = path.parent.name == "runs"
        others = sorted(path.parent.glob("*.npz") if is_run else path.parents[1].rglob(path.name))
        others = [other for other in others if other != path]
        if others:
            shutil.copy(rng.choice(others), path)
    return f"{kind} {path.name}"
