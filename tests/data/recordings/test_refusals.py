"""What cannot be cut, placed, predicted or split is named in one line: what it must be, and what it is."""

import numpy as np
import pytest

from dse.base.records import Events, Rasters, Signals, Spikes
from dse.config.settings import Column, KFold, LeaveOut, Preprocessing, Split, Stratified, Window
from dse.data.recordings import RecordingError, doubts
from dse.data.recordings.pooling import pooling
from dse.data.recordings.splits import split
from dse.data.recordings.targets import heads, target
from dse.data.recordings.windows import cut, place

COLUMNS = {
    "fabric": np.array(["silk", "silk", "silk", "wool", "wool", "wool"]),
    "velocity": np.array([-100, 20, 100, -20, 20, 20], np.int8),
    "repetition": np.array([0, 1, 2, 0, 1, 2], np.int8),
    "part": np.array(["train", "val", "train", "val", "train", "train"]),
    "force": np.array([150, 150, 200, 200, 200, 150]),
}
CODES, CLASSES = np.array([0, 0, 0, 1, 1, 1]), ("silk", "wool")
EVENTS = Events(*np.zeros((4, 1), np.int64), np.array([0, 1]), 1, 1, {})
RASTERS = Rasters(Spikes(np.arange(5), np.zeros(4, np.int32), 4, 1, 2.0), {})
ABS = Column("velocity", abs=True)

# The small group with wool lacks its other classes most where the large one with wool already is.
TORN = [["linen", "cotton"] * 4, ["wool"] + ["silk"] * 6, ["silk"] * 6, ["wool", "linen", "cotton"]]
KINDS = ("wool", "linen", "cotton", "silk")


def signals(*lengths, **columns):
    return Signals(np.zeros((sum(lengths), 1), np.float32), np.cumsum([0, *lengths]), 5.0, columns)


def placed(window, onset=None):
    used = np.ones(2, dtype=bool)
    return place(window, np.array([10, 8]), used, None if onset is None else np.array(onset))


def by(columns=COLUMNS, codes=CODES, classes=CLASSES, **keys):
    return split(columns, np.asarray(codes), classes, Split(**keys))


def drawn(*codes, **keys):
    return by({}, codes, stratified=Stratified(**keys))


def fold(columns=COLUMNS, codes=CODES, classes=CLASSES, **keys):
    return by(columns, codes, classes, k_fold=KFold(**keys))


def grouped(part):
    """Wool is in no training recording, but in this part."""
    group = {"group": np.array([0, 0, 1, 2, 1, 2])}
    codes = [0, 0, 0, 1, 0, 1] if part == "test" else [0, 0, 1, 0, 1, 0]
    return by(group, codes, train={"group": 0}, validation={"group": 1}, test={"group": 2})


def torn():
    plate = np.repeat(np.arange(4), [len(x) for x in TORN])
    codes = [KINDS.index(name) for names in TORN for name in names]
    train, validation, _ = fold({"plate": plate}, codes, KINDS, k=2, group="plate")
    held = [np.asarray(codes)[x] for x in (train, validation)]
    assert 0 in held[0] and 0 not in held[1], "validation may lack a class"
    return fold({"plate": plate}, codes, KINDS, k=2, group="plate", fold=1)


FORCE = {"force": np.tile([1, 2, 3], 8), "plate": np.zeros(24, int)}
HALVES = np.repeat([0, 1], 12)
REFUSED = [
    *(
        (lambda crop=crop: pooling(Preprocessing(1, crop=crop), 8, 4), f"frame of 8 x 4 pixels, got {got}$")
        for crop, got in {
            (0, 0, 9, 4): "x 0 to 8 and y 0 to 3",
            (7, 0, 2, 4): "x 7 to 8 and y 0 to 3",
            (0, 3, 8, 2): "x 0 to 7 and y 3 to 4",
            (8, 0, 1, 1): "x 8 to 8 and y 0 to 0",
        }.items()
    ),
    (lambda: pooling(Preprocessing(1, crop="pins"), 8, 4), "positions of pins are unknown, got pins"),
    (
        lambda: cut(signals(9, 5), Window(cut_steps=6)),
        "window.cut_steps = 6 does not fit recording 1: it has 5 steps",
    ),
    (
        lambda: cut(RASTERS, Window(cut_steps=5)),
        "window.cut_steps = 5 does not fit recording 0: it has 4 steps",
    ),
    (lambda: cut(EVENTS, Window(cut_steps=5)), "window.cut_steps does not apply to events, .* got 5"),
    *(
        (
            lambda name=name: cut(signals(4, **{name: np.array([3])}), Window(cut_steps=2)),
            f"cannot contain '{name}' together with",
        )
        for name in ("recording", "window")
    ),
    (lambda: placed(Window(9)), "a window of 9 steps does not fit recording 1: it has 8 steps"),
    (lambda: placed(Window(9, "start")), "a window of 9 steps does not fit recording 1: it has 8 steps"),
    (lambda: placed(Window(8, "contact_onset"), [3, 0]), "not fit recording 0 from its contact onset at"),
    (lambda: placed(Window(8, "contact_onset"), [0, -1]), "1 has no contact onset at .*onset_threshold = 3"),
    (lambda: placed(Window(None)), "recording 0 has 10 steps, recording 1 has 8"),
    (lambda: target(COLUMNS, "fabrik"), r"task.target: no column 'fabrik' .*Did you mean 'fabric'\?"),
    (lambda: target(COLUMNS, Column("fabric", abs=True)), "abs needs numbers, but column 'fabric' holds <U4"),
    (lambda: target(COLUMNS, ()), "task.target must be a column, got none"),
    (
        lambda: target({"a": np.array(["x|y", "x"]), "b": np.array(["z", "y|z"])}, ("a", "b")),
        r"same name 'x\|y\|z'",
    ),
    (lambda: heads(COLUMNS, "fabric", CODES), "task.joint needs at least two columns .*, got fabric"),
    (lambda: heads(COLUMNS, ("fabric",), CODES), "at least two columns in task.target, got fabric"),
    (lambda: heads(COLUMNS, ("velocity", ABS), CODES), "distinct columns .*, got 'velocity' twice"),
    (lambda: doubts.guard(("fabric", "velocity"), ("repetition", "fabric")), "cannot use column 'fabric'"),
    (lambda: by(train={"repetition": 0}, validation={"repetition": [0, 1]}), "recording 0 is in train and"),
    (lambda: by(train={"rep": 0}, validation={"repetition": 1}), "split.train: no column 'rep' .*; known: "),
    (lambda: by(train={"repetition": 0}, validation={"repetition": 7}), "no value 7; its values are 0, 1, 2"),
    (lambda: by(train={"part": "trian"}, validation={"part": "val"}), "no value 'trian'; its values are"),
    (lambda: by(leave_out=LeaveOut("force", 7)), "split.leave_out: column 'force' has no value 7"),
    (
        lambda: by(train={"repetition": 2, "part": "val"}, validation={"repetition": 1}),
        "train selects no recording",
    ),
    (
        lambda: by(train={"repetition": 0}, validation={"repetition": 2, "part": "val"}),
        "validation selects no rec",
    ),
    (lambda: grouped("validation"), "class 'wool' is in validation but missing from train"),
    (lambda: grouped("test"), "class 'wool' is in test but missing from train"),
    (lambda: drawn(*[0] * 10, 1, 1, validation=0.2), r"class 'wool' has 2 recordings, too few for"),
    (lambda: drawn(*[0] * 4, validation=0.5, test=0.5), r"has 4 recordings, too few for validation 0\.5"),
    (lambda: by(stratified=Stratified(0.2, 0.2, group="force")), "class 'silk' has 2 groups of column"),
    (lambda: by(stratified=Stratified(0.5, 0.5, group="force")), r"must leave recordings .*validation 0\.5"),
    (lambda: fold(k=4), "class 'silk' has 3 recordings, too few for k = 4"),
    (lambda: fold(k=3, group="force"), "class 'silk' has 2 groups of column 'force', too few for k = 3"),
    (lambda: fold(k=3, test=0.4), "class 'silk' has 2 recordings, too few for k = 3"),
    (lambda: fold(k=2, test=0.01), r"class 'silk' has too few recordings for test 0\.01"),
    (lambda: fold(k=2, group="plate"), r"split\.k_fold\.group: no column 'plate' among data\.columns"),
    (torn, "class 'wool' is missing from train in fold 1 of 2: all its"),
    (lambda: fold(FORCE, HALVES, k=2, test={"force": 7}), r"split\.k_fold\.test: column 'force' has no"),
    (lambda: fold(FORCE, HALVES, k=2, test={"force": 3}, group="plate"), "group '0' is both in the test"),
]
KEYS = [
    (lambda: placed(Window(3, "contact_onset")), "place needs onset"),
    (lambda: Window(every_steps=5), "window.every_steps needs window.cut_steps"),
    (lambda: Window(n_steps=9, cut_steps=8), "window.n_steps must be at most window.cut_steps = 8, got 9"),
    (lambda: KFold(k=3, fold=3), r"split\.k_fold\.fold must be below k = 3, got 3"),
    *(
        (lambda keys=keys: Split(**keys), "split (must|needs)")
        for keys in (
            {},
            {"train": {"part": "train"}},
            {"validation": {"part": "val"}},
            {"train": {}, "validation": {"part": "val"}},
            {"train": {"part": "train"}, "validation": {"part": "val"}, "stratified": Stratified(0.2)},
            {"stratified": Stratified(0.2), "leave_out": LeaveOut("force", 150)},
        )
    ),
]


@pytest.mark.parametrize(
    ("kind", "call", "message"), [*((RecordingError, *x) for x in REFUSED), *((ValueError, *x) for x in KEYS)]
)
def test_refusals(kind, call, message):
    with pytest.raises(kind, match=message) as error:
        call()
    assert "\n" not in str(error.value)
    doubts.guard(("fabric",), ("repetition",))
