"""Which recordings each run of a cross-validation sees, and what its runs have in common."""

import pytest

from dse import store
from dse.config import ConfigError
from dse.data.dataset import load
from dse.data.dataset.cache import usual_root
from dse.data.dataset.files import read_meta
from dse.data.recordings import RecordingError
from dse.study import explore
from tests.tiny_study import make_space

K = 3
SPLIT = {"k_fold": {"k": K, "test": 0.25}}


@pytest.fixture(scope="module")
def folded(tmp_path_factory):
    """Two designs, three folds each, and where their data sets are."""
    folder = tmp_path_factory.mktemp("folded")
    return folder, explore.run(space(folder), folder / "results", progress=False)


def space(folder, **changes):
    model = {"kind": "fake", "hidden": {"choice": [[4], [16]]}}
    return make_space(folder, **{"split": SPLIT, "model": model, "execution": {"jobs": 1}} | changes)


def parts(record):
    data = load(usual_root() / record["data"])
    return tuple(part.tolist() for part in (data.train, data.validation, data.test))


def test_every_repeat_is_a_fold(folded):
    _, found = folded
    assert found.space["search"]["repeats"] == K
    assert set(found.trials["repeats"]) == {K} and set(found.trials["status"]) == {"finished"}
    for trial in (0, 1):
        records = found.runs(trial)
        assert (
            [r["sections"]["split"]["k_fold"]["fold"] for r in records]
            == [0, 1, 2]
            == [r["repeat"] for r in records]
        )
        folds = [parts(record) for record in records]
        held = folds[0][2]
        assert len(held) == 9 and all(test == held for _, _, test in folds)
        assert sorted([*held, *(i for _, validation, _ in folds for i in validation)]) == list(range(36))
        for train, validation, test in folds:
            assert sorted(train + validation + test) == list(range(36))


def test_folds_share_their_spikes_and_designs_their_folds(folded):
    _, found = folded
    keys = [[record["data"] for record in found.runs(trial)] for trial in (0, 1)]
    assert keys[0] == keys[1] and len(set(keys[0])) == K
    assert len({read_meta(usual_root() / key).spikes for key in keys[0]}) == 1


def test_folds_are_known_again(folded):
    folder, found = folded
    files = sorted((found.folder / "runs").glob("*.npz"))
    before = [(path, path.stat().st_mtime_ns) for path in files]
    store.remove(store.run_file(found.folder, 1, 2))
    again = explore.run(space(folder), folder / "results", progress=False)
    lost = store.run_file(found.folder, 1, 2)
    changed = {path for path, stamp in before if path.stat().st_mtime_ns != stamp}
    assert changed == {lost} and again.runs(1)[2]["sections"]["split"]["k_fold"]["fold"] == 2


def test_more_repeats_go_through_the_folds_again(tmp_path):
    twice = {"sampler": "grid", "repeats": 2 * K}
    found = explore.run(space(tmp_path, model={"kind": "fake"}, search=twice), tmp_path, progress=False)
    records = found.runs(0)
    assert [r["sections"]["split"]["k_fold"]["fold"] for r in records] == [0, 1, 2, 0, 1, 2]
    assert [r["data"] for r in records[:K]] == [r["data"] for r in records[K:]]


@pytest.mark.parametrize(
    ("search", "message"),
    [
        ({"repeats": 4}, r"search\.repeats must be a multiple of split\.k_fold\.k = 3, .* got 4"),
        ({"repeats": 3, "repeats_on_front": 5}, r"search\.repeats_on_front must be a multiple .* got 5"),
    ],
)
def test_folds_are_trained_equally_often(tmp_path, search, message):
    with pytest.raises(ConfigError, match=message):
        space(tmp_path, search={"sampler": "grid", **search})


def test_folds_that_cannot_be_are_named(tmp_path):
    split = {"k_fold": {"k": 13}}
    with pytest.raises(RecordingError, match="class 'felt' has 12 recordings, too few for k = 13"):
        explore.run(space(tmp_path, split=split), tmp_path, progress=False)
