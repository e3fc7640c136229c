"""Renders the report of a dataset in a headless Chromium without a network, and looks at the picture.

    python report.py GELSIM DATASET_DIR

Without a Chromium it says so and ends well.
"""

import html.parser
import os
import shutil
import subprocess
import sys
import tempfile

import numpy
from PIL import Image

gelsim, dataset = sys.argv[1:]
names = ["chromium", "chromium-browser", "google-chrome"]
browser = next((path for path in map(shutil.which, names) if path), None)
if browser is None:
    print("no Chromium is installed: the report's page is not rendered")
    sys.exit(0)


class Links(html.parser.HTMLParser):
    """Everything that a page would load."""

    found: list[str] = []

    def handle_starttag(self, tag, attributes):
        assert tag not in ("script", "link", "iframe"), tag
        self.found += [value for name, value in attributes if name in ("src", "href", "srcset", "data")]


def render(page, width, height, folder):
    """A screenshot as an array, once nothing was asked of the network and nothing was said in the console."""
    picture = f"{folder}/{width}.png"
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run"]
    command += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command += ["--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr", f"--user-data-dir={folder}/{width}"]
    command += [f"--screenshot={picture}", f"--window-size={width},{height}", f"file://{page}"]
    # Where that is allowed, in a network of its own without any way out.
    if subprocess.run(["unshare", "--net", "true"], capture_output=True).returncode == 0:
        command = ["unshare", "--net"] + command
    said = subprocess.run(command, capture_output=True, text=True, timeout=240).stderr
    # What the browser says of its own accord on a busy machine is not the page's.
    own = "Slow network is detected"
    console = [line for line in said.splitlines() if ":CONSOLE" in line and own not in line]
    assert not console, console
    return numpy.asarray(Image.open(picture).convert("RGB"))


with tempfile.TemporaryDirectory() as folder:
    page = os.path.join(folder, "report.html")
    subprocess.run([gelsim, "report", dataset, "--out", page], check=True, stdout=subprocess.DEVNULL)
    text = open(page, encoding="utf-8").read()
    links = Links()
    links.feed(text)
    within = [link for link in links.found if link.startswith("#")]
    assert within and all(f'id="{link[1:]}"' in text for link in within)
    assert all(link.startswith("data:image/png;base64,") for link in set(links.found) - set(within))
    assert "url(" not in text and "@import" not in text

    for width, height in [(1200, 6000), (390, 12000)]:
        picture = render(page, width, height, folder)
        assert picture.shape == (height, width, 3), picture.shape
        colours, counts = numpy.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
        assert len(colours) > 1000, f"{len(colours)} colours"
        assert counts.max() < 0.95 * counts.sum(), "almost all of it is of one colour"
        for split in [(0, 114, 178), (230, 159, 0), (0, 158, 115)]:
            assert (picture == split).all(axis=2).sum() > 100, f"too little of the colour {split}"
        # Nothing is wider than the window: the right margin is white all the way down.
        assert (picture[:, -4:] == 255).all(), f"something reaches over the border at {width} px"
    # A click on a sample shows it over the whole window, on dark.
    sample = next(link for link in within if not link.startswith("#of-"))
    picture = render(f"{page}{sample}", 1201, 800, folder)
    corners = picture[[4, 4, -5, -5], [4, -5, 4, -5]]
    middle = picture[300:500, 500:700].reshape(-1, 3)
    assert (corners < 80).all() and len(numpy.unique(middle, axis=0)) > 100, "no large image of a sample"
    print(f"report of {len(text)} bytes rendered at 1200 and 390 px: whole, without network, silent")
