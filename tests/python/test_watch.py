"""`gelsim preview --watch` in a real browser: the sheet, the label under the pointer, edits, the keyboard.

    pytest tests/python/test_watch.py --full -rP

also shows how much memory the command holds after many edits.
"""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request

import pytest
from browser import Browser

# The file and the class have names that a page must not take for its own text.
SCRIPT = "<script>alert(1)</script><img src=x onerror=alert(2)>"
JOB = f"""
[dataset]
name = "watched"
samples = 40
seed = 5

[sensor]
preset = "gelsight-2014"
resolution_px = [160, 120]

[[object]]
path = "cube.obj"
class = "{SCRIPT}"

[pose]
yaw_deg = [0.0, 360.0]

[indentation]
depth_mm = [0.3, 0.9]
"""

SHOWN = "document.querySelectorAll('.tile img').length == 36 && [...document.images].every((image) => image.complete)"
DONE = "/samples? in/.test(document.getElementById('status').textContent)"
PROBLEM = "!document.getElementById('problem').hidden"
LABEL = "document.getElementById('label').innerText"


@pytest.fixture
def folder(project, tmp_path):
    """A folder with the job and its mesh."""
    (tmp_path / "cube.obj").write_bytes((project / "objects/cube.obj").read_bytes())
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path


@contextlib.contextmanager
def watched(gelsim_path, folder, *flags):
    """The command that watches the folder's job, and the address that it prints."""
    line = [gelsim_path, "preview", "job.toml", "--watch", *flags]
    with subprocess.Popen(line, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as command:
        try:
            address = command.stdout.readline().strip()
            assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[0-9a-f]{32}/", address)
            yield command, address
        finally:
            command.send_signal(signal.SIGINT)
            assert command.wait() == 130


@pytest.fixture
def page(gelsim_path, folder):
    """A browser that shows the folder's job."""
    with watched(gelsim_path, folder) as (_, address), Browser(folder / "browser") as browser:
        browser.open(address)
        browser.wait(SHOWN)
        browser.wait(DONE)
        yield browser
        # No policy was broken, and nothing was asked for that is not there.
        assert not browser.console


def edit(folder, *changes):
    """Edits the job as an editor does: a new file in the place of the old one."""
    text = JOB
    for before, after in changes:
        assert text.count(before) == 1
        text = text.replace(before, after)
    (folder / "job.toml.new").write_text(text)
    os.replace(folder / "job.toml.new", folder / "job.toml")


def brightness(browser):
    """The mean of the first tactile image."""
    return browser.evaluate("""(() => {
        const image = document.querySelector(".tile img"), canvas = new OffscreenCanvas(40, 30), pen = canvas.getContext("2d");
        pen.drawImage(image, 0, 0, 40, 30);
        const values = pen.getImageData(0, 0, 40, 30).data;
        return values.reduce((sum, value) => sum + value, 0) / values.length;
    })()""")


def test_the_label_is_shown_under_the_pointer(page):
    assert "Point at a sample" in page.evaluate(LABEL)
    page.point_at("#sheet li:nth-child(2) .tile")
    page.wait(f"{LABEL}.includes('#1 ')")
    text = page.evaluate(LABEL)
    assert all(re.search(rf"^{name}\b", text, re.M) for name in ("class", "depth", "pose", "force", "health", "shading")), text
    # Whoever goes on to the label may pass over others, and the label's text does not hang on the pointer.
    page.point_at("#sheet li:nth-child(1) .tile")
    page.point_at("#label")
    time.sleep(0.5)
    assert "#1 " in page.evaluate(LABEL)
    page.click("#known details:last-of-type summary")
    page.wait("document.getElementById('json').innerText.includes('\"schema_version\": 1')")


def test_names_are_text(page):
    page.point_at(".tile")
    page.wait(f"{LABEL}.includes('<script>alert(1)')")
    assert SCRIPT in page.evaluate("document.querySelector('.tile').innerText")
    assert page.evaluate("document.scripts.length") == 1 and not page.evaluate("document.querySelectorAll('[src=x]').length")


def test_an_edit_changes_the_pictures_and_says_what_was(page, folder):
    page.point_at(".tile")
    page.wait(f"{LABEL}.includes('#0 ')")
    bright = brightness(page)
    edit(folder, ("depth_mm = [0.3, 0.9]", "depth_mm = 0.45\n[camera]\nexposure = 0.5"))
    page.wait(f"{LABEL}.includes('was ')")
    assert re.search(r"^depth\s+0\.45 mm\s+was 0\.\d+ mm$", page.evaluate(LABEL), re.M), page.evaluate(LABEL)
    page.wait(SHOWN)
    dark = brightness(page)
    assert dark < 0.9 * bright
    # The pictures before it, as long as the key is held.
    page.call("Input.dispatchKeyEvent", type="keyDown", key="b", code="KeyB", windowsVirtualKeyCode=66)
    page.wait(SHOWN)
    assert abs(brightness(page) - bright) < 1
    page.call("Input.dispatchKeyEvent", type="keyUp", key="b", code="KeyB", windowsVirtualKeyCode=66)
    page.wait(SHOWN)
    assert abs(brightness(page) - dark) < 1


def test_an_error_stands_over_the_last_sheet_until_it_is_mended(page, folder):
    edit(folder, ("seed = 5", "sed = 5"))
    page.wait(PROBLEM)
    text = page.evaluate("document.getElementById('problem').innerText")
    assert "unknown key `sed`" in text and "job.toml:5:1" in text and "did you mean `seed`?" in text
    assert page.evaluate(SHOWN)
    # An error that quotes what was written, too.
    edit(folder, ("cube.obj", "<img src=x onerror=alert(3)>.obj"))
    page.wait("document.getElementById('problem').innerText.includes('<img src=x onerror=alert(3)>')")
    edit(folder)
    page.wait(f"!({PROBLEM}) && {DONE}")
    assert page.evaluate(SHOWN)


def test_it_is_used_by_the_keyboard(page):
    for _ in range(10):
        page.press("Tab", 9)
        if page.evaluate("document.activeElement.classList.contains('tile')"):
            break
    page.wait(f"{LABEL}.includes('#0 ')")
    page.press("Tab", 9)
    page.wait(f"{LABEL}.includes('#1 ')")
    page.call("Input.dispatchKeyEvent", type="keyDown", key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r")
    page.call("Input.dispatchKeyEvent", type="keyUp", key="Enter", code="Enter", windowsVirtualKeyCode=13)
    page.wait("document.getElementById('large').open")
    page.wait("[...document.querySelectorAll('#pictures img')].every((image) => image.complete && image.naturalWidth == 160)")
    page.press("ArrowRight", 39)
    page.wait("document.getElementById('caption').innerText.startsWith('#2 ')")
    page.press("Escape", 27)
    page.wait("!document.getElementById('large').open && document.activeElement.dataset.index == '2'")


@pytest.mark.parametrize("width, dark", [(1280, False), (400, True)], ids=["wide", "narrow and dark"])
def test_nothing_is_cut_off(page, width, dark):
    address = page.evaluate("location.href")
    page.open(address, width=width, dark=dark)
    page.wait(SHOWN)
    page.point_at(".tile")
    page.wait(f"{LABEL}.includes('#0 ')")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    box = "getBoundingClientRect()"
    assert page.evaluate(f"[...document.querySelectorAll('.tile, #label')].every((it) => it.{box}.right <= innerWidth)")
    assert page.evaluate(f"document.getElementById('label').{box}.bottom <= innerHeight")
    # Text stands out from what is behind it.
    assert page.evaluate("""(() => {
        const light = (text) => text.match(/\\d+/g).slice(0, 3).reduce((sum, level) => sum + Number(level), 0) / 3;
        const paper = document.body.appendChild(document.createElement("i"));
        paper.style.background = "Canvas";
        const behind = getComputedStyle(paper).backgroundColor;
        return Math.abs(light(getComputedStyle(document.getElementById("label")).color) - light(behind));
    })()""") > 150


def test_a_page_says_when_the_command_has_ended(gelsim_path, folder):
    with Browser(folder / "browser") as browser:
        with watched(gelsim_path, folder) as (_, address):
            browser.open(address)
            browser.wait(SHOWN)
        browser.wait("document.getElementById('status').innerText.includes('gelsim has ended')")


@pytest.mark.full
def test_memory_does_not_grow_over_many_edits(gelsim_path, folder):
    with watched(gelsim_path, folder) as (command, address):

        def ask(path):
            with urllib.request.urlopen(address + path) as answer:
                return answer.read()

        resident = []
        for number in range(120):
            # Every tenth job is broken.
            edit(folder, ("seed = 5", "sed = 5" if number % 10 == 9 else f"seed = {number}"))
            end, revision = time.monotonic() + 60, 0
            while True:
                sheet = ask(f"sheet?after={revision}").decode()
                revision = int(re.match(r'\{"revision":(\d+)', sheet)[1])
                rendered = '"is_busy":false' in sheet and f'"seed":{number},' in ask("label/11").decode()
                if "did you mean" in sheet if number % 10 == 9 else rendered:
                    break
                assert time.monotonic() < end
            for index in range(12):
                ask(f"picture/{index}/0/1")
            resident.append(int(re.search(r"VmRSS:\s+(\d+)", open(f"/proc/{command.pid}/status").read())[1]) / 1024)
        print("MB after each ten edits:", *(f"{mb:.1f}" for mb in resident[9::10]), file=sys.stdout)
        assert resident[-1] < 1.1 * resident[30] + 2
