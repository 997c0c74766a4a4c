"""A device that is not there is a fault with its line, found before any work."""

import subprocess
import sys

import pytest

from dse.config import ConfigError, load_space, settings
from dse.study import explore
from tests.spaces import write_space

pytestmark = pytest.mark.usefixtures("torch")


@pytest.fixture
def no_gpu(torch, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(settings, "find_spec", lambda name: name)


@pytest.fixture
def path(tmp_path):
    return write_space(tmp_path, ("jobs: 1", "device: cuda"))


def test_no_package(no_gpu, path, monkeypatch):
    monkeypatch.setattr(settings, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"20: execution\.device cuda needs the package torch, which"):
        load_space(path, check_data=True)


def test_a_family_that_trains_on_the_cpu_alone(tmp_path):
    path = write_space(tmp_path, ("jobs: 1", "device: cuda"), ("kind: snn, ", "kind: columns, "))
    with pytest.raises(ConfigError) as caught:
        load_space(path)
    assert "20: execution.device must be cpu for model columns, got cuda" in str(caught.value)


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_sampler_that_needs_a_package(command, tmp_path, capsys, monkeypatch):
    from dse.cli import main

    path = write_space(tmp_path, ("sampler: grid, batch: 2", "sampler: gp, n_trials: 4"))
    assert load_space(path, check_data=True).search.sampler_name == "gp"
    monkeypatch.setattr(settings, "find_spec", lambda name: None)
    assert main([command, str(path)]) == 2
    fault = "search.sampler 'gp' needs the package torch, which is not installed"
    fault += ": pip install 'dse-spiking[torch]'"
    assert capsys.readouterr().err.splitlines() == [f"{path}:19: {fault}"]


def test_a_device_that_is_there(torch, no_gpu, path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert load_space(path, check_data=True).execution.device == "cuda"


def test_a_study_does_not_begin_without_its_device(no_gpu, path, tmp_path):
    space = load_space(path)  # reading a search space elsewhere than where it runs is no fault
    with pytest.raises(ConfigError, match=r"execution\.device cuda needs a CUDA device"):
        explore.run(space, tmp_path / "results", progress=False)
    assert not (tmp_path / "results").exists()


def test_the_command_line(no_gpu, path, capsys):
    from dse.cli import main

    for command in ("check", "run"):
        assert main([command, str(path)]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith(f"{path}:20: execution.device cuda needs a CUDA device")


def test_the_cpu_imports_no_library():
    code = (
        "import sys; from dse.config.settings import missing; print(missing('cpu'), 'torch' in sys.modules)"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["None", "False"]
