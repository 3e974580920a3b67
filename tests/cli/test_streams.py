"""Where a command writes and what it runs on is not as it should be: nothing, or one line."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp
from small_scene import make_scene

from mmocap_warp import cli
from mmocap_warp.cli.console import BAD_INPUT, BROKEN_PIPE, FAILURE, USAGE
from mmocap_warp.scenes import ROOT

WALK = str(ROOT / "walk")
COMMANDS = (
    ["--version"],
    ["--help"],
    ["cameras", WALK],
    pytest.param(["cameras", WALK, "--json"], marks=pytest.mark.nightly),
)
"""What Python prints, what the help's own writer does, and what a command does."""
pytestmark = pytest.mark.skipif(os.name != "posix", reason="about POSIX's pipes and devices")


def run(*arguments: str, stdout: int | None = None, **environment: str) -> subprocess.CompletedProcess:
    # Buffered, as it is on everybody's machine: what is not written yet is written as Python ends.
    settings = {key: value for key, value in os.environ.items() if key not in ("PYTHONUNBUFFERED", "MMOCAP_DEBUG")}
    command = [sys.executable, "-m", "mmocap_warp", *arguments]
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, env=settings | environment)


@pytest.mark.parametrize("arguments", COMMANDS, ids=str)
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_closed_pipe_is_nothing_to_talk_about(arguments, unbuffered):
    reader, writer = os.pipe()
    os.close(reader)
    answer = run(*arguments, stdout=writer, PYTHONUNBUFFERED=unbuffered)
    os.close(writer)
    assert answer.stderr == ""
    assert answer.returncode == BROKEN_PIPE


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize("arguments", COMMANDS, ids=str)
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_disk_behind_stdout_is_one_line(arguments, unbuffered):
    with open("/dev/full", "w") as full:
        answer = run(*arguments, stdout=full.fileno(), PYTHONUNBUFFERED=unbuffered)
    assert answer.returncode == FAILURE
    assert answer.stderr.count("\n") == 1
    assert "cannot write (No space left on device)" in answer.stderr
    assert "unexpected" not in answer.stderr


def test_a_gpu_that_is_not_there_is_wrong_usage(tmp_path, capsys):
    for arguments in (["track", WALK, "-o", str(tmp_path / "r.usdc")], ["bench"]):
        command = [*arguments, "--device", "cuda"]
        if wp.is_cuda_available():
            answer = run(*command, CUDA_VISIBLE_DEVICES="")
            code, said = answer.returncode, answer.stderr
        else:
            code, said = cli.main(command), capsys.readouterr().err
        assert code == USAGE
        assert said.splitlines()[-1].startswith("mmocap: --device must be auto or one of ['cpu'], got 'cuda'")
        assert said.count("\n") == 1


@pytest.mark.parametrize("closed", ["1", "2", "0 1 2"])
def test_a_result_is_written_whatever_becomes_of_messages(tmp_path, closed):
    make_scene(tmp_path)
    answer = in_shell("".join(f"exec {stream}>&-; " for stream in closed.split()), "mask", tmp_path, tmp_path / "out")
    assert answer.returncode == 0, answer.stderr
    assert len(list((tmp_path / "out").rglob("*.png"))) == 9
    missing = in_shell(f"exec {closed[-1]}>&-; ", "mask", tmp_path / "nowhere", tmp_path / "other")
    assert missing.returncode == BAD_INPUT


@pytest.mark.parametrize("stderr", ["/dev/full", "pipe"])
def test_a_stderr_that_takes_nothing_ends_no_run(tmp_path, stderr):
    make_scene(tmp_path)
    reads_one_line = "exec 2> >(head -n 0); sleep 0.2; "
    answer = in_shell(f"exec 2>{stderr}; " if stderr != "pipe" else reads_one_line, "mask", tmp_path, tmp_path / "out")
    assert answer.returncode == 0
    assert (tmp_path / "out" / "scene.toml").is_file()


def test_a_name_that_the_terminal_does_not_know_is_printed_with_escapes(tmp_path):
    folder = os.fsencode(tmp_path) + b"/caf\xe9"
    make_scene(tmp_path)
    os.mkdir(folder)
    shutil.copytree(tmp_path / "masks", os.fsdecode(folder) + "/masks")
    for name in ("scene.toml", "calibration.toml"):
        shutil.copy(tmp_path / name, os.fsdecode(folder))
    answer = run("cameras", os.fsdecode(folder), stdout=subprocess.PIPE, PYTHONIOENCODING="utf-8:strict")
    assert answer.returncode == 0, answer.stderr
    assert "caf\\udce9" in answer.stdout


def in_shell(redirected: str, name: str, scene: Path, output: Path) -> subprocess.CompletedProcess:
    """A command in a shell that has done something to its streams."""
    command = ["bash", "-c", f'{redirected}exec "$@"', "bash", sys.executable, "-m", "mmocap_warp"]
    return subprocess.run([*command, name, str(scene), "-o", str(output)], capture_output=True, text=True, timeout=120)


LOADING = """
import sys
from mmocap_warp import cli
from mmocap_warp.device.resolve import start_quietly


def command(*_, **__):
    start_quietly()
    import warp as wp
    from mmocap_warp.kernels.body import root_frame

    wp.load_module(root_frame, device="cpu")


cli.app = command
sys.exit(cli.main(["cameras"]))
"""


def loaded(cache: str) -> subprocess.CompletedProcess:
    """A command that does nothing but load kernels."""
    settings = os.environ | {"WARP_CACHE_PATH": cache, "MMOCAP_DEBUG": "0"}
    return subprocess.run([sys.executable, "-c", LOADING], capture_output=True, text=True, env=settings)


def assert_names_the_cache(answer: subprocess.CompletedProcess, cache: str) -> None:
    assert answer.returncode == BAD_INPUT, answer.stderr
    *native, line = answer.stderr.splitlines()  # LLVM says in a line of its own that it does not know the file
    assert line.startswith(f"mmocap: {cache}")
    assert "WARP_CACHE_PATH" in line
    assert not any("Traceback" in said for said in native)


def test_a_kernel_cache_that_cannot_be_written_is_named():
    assert_names_the_cache(loaded("/dev/null/cache"), "/dev/null/cache")


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> Path:
    """A kernel cache that one command has filled."""
    folder = tmp_path_factory.mktemp("cache")
    assert loaded(str(folder)).returncode == 0
    return folder


@pytest.mark.parametrize(("ending", "content"), [(".o", b""), (".o", b"\x7fELF and no more"), (".meta", b"{")])
def test_a_damaged_kernel_cache_is_named(filled, tmp_path, ending, content):
    cache = Path(shutil.copytree(filled, tmp_path / "cache"))
    kept = list(cache.rglob(f"*{ending}"))
    assert kept
    for file in kept:
        file.write_bytes(content)
    assert_names_the_cache(loaded(str(cache)), str(cache))
