"""Disks that fill up under sets of sensors and logs: said in words, nothing half-written under a final name, and the same
command ends the work once there is room. Those of datasets are in tests/faults, those of exports beside their tests.
"""

import pytest
import test_inject
from processes import fill_disk, run
from sets import content

pytestmark = pytest.mark.full


def files(path):
    """What is written, by its path: of a folder all files."""
    if path.is_file():
        return {"": path.read_bytes()}
    return {str(file.relative_to(path)): content(file) for file in sorted(path.rglob("*")) if file.is_file()}


# What a command finds, the command, and whether an unfinished work stays under its name.
CASES = {
    "a set of sensors": (test_inject.set_of_sensors, "generate job.toml --threads 1 --quiet --out", True),
    "a log": (test_inject.frames, test_inject.RENDER_LOG.replace("--out out/tactile.mcap", "--layers depth,normal,pressure --out"), False),
}


@pytest.mark.parametrize("name", CASES)
def test_a_disk_that_fills_up_is_named_and_loses_nothing(gelsim_path, tmp_path, monkeypatch, name):
    prepare, command, stays = CASES[name]
    prepare(tmp_path)
    # Paths of what is read are relative to where it is written, so each disk is as deep as the other.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "whole").mkdir()
    end = "work" if stays else "work.mcap"
    line = [gelsim_path, *command.split()]
    run(*line, tmp_path / "whole" / end)
    expected, filled = files(tmp_path / "whole" / end), 0
    pages = sum(-(-path.stat().st_size // 4096) for path in (tmp_path / "whole").rglob("*") if path.is_file())
    for size in range(1, pages + 1):
        disk, again = tmp_path / f"d{size:04}", tmp_path / f"again-{size}"
        disk.mkdir()
        done = fill_disk([*line, disk / end], disk / end, 4 * size, again, stays)
        assert files(again) == expected, size
        filled += done.returncode
    print(f"{name}: {filled} sizes of a full disk survived, of {pages} pages")
    assert filled > 3, "the disk is rarely full"
