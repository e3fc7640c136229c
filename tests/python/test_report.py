"""The report of a dataset in a headless Chromium without a network: a look at the picture."""

import html.parser
import subprocess

import pytest

for name, package in [("numpy", "numpy"), ("PIL", "pillow")]:
    pytest.importorskip(name, reason=f"no {package}: pip install {package}")

import numpy
from browser import find_browser
from PIL import Image

SPLIT_COLOURS = [(0, 114, 178), (230, 159, 0), (0, 158, 115)]


class Parts(html.parser.HTMLParser):
    """The elements of a page, and everything that it would load."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.links = set(), []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        self.links += [value for name, value in attributes if name in ("src", "href", "srcset", "data")]


@pytest.fixture(scope="module")
def page(run_gelsim, quickstart, tmp_path_factory):
    """The quickstart's report."""
    page = tmp_path_factory.mktemp("report") / "report.html"
    run_gelsim("report", quickstart, "--out", page)
    return page


@pytest.fixture(scope="module")
def text(page):
    return page.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def within(text):
    """Links to places in the page."""
    return [link for link in Parts(text).links if link.startswith("#")]


def test_the_page_runs_nothing(text):
    assert not Parts(text).tags & {"script", "link", "iframe"}


def test_links_lead_to_places_in_the_page(text, within):
    assert within and not [link for link in within if f'id="{link[1:]}"' not in text]


def test_images_are_in_the_page(text, within):
    assert all(link.startswith("data:image/png;base64,") for link in set(Parts(text).links) - set(within))
    assert "url(" not in text and "@import" not in text


@pytest.fixture(scope="module")
def render(tmp_path_factory):
    """A screenshot as an array, and what the page said in the console."""
    browser = find_browser()
    folder = tmp_path_factory.mktemp("screenshots")
    # Where that is allowed, in a network of its own without any way out.
    alone = ["unshare", "--net"]
    alone = [] if subprocess.run([*alone, "true"], capture_output=True).returncode else alone

    def render(address, width, height):
        picture = folder / f"{width}.png"
        line = [*alone, browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run"]
        line += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
        line += ["--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr"]
        line += [f"--user-data-dir={folder}/{width}", f"--screenshot={picture}", f"--window-size={width},{height}"]
        said = subprocess.run([*line, address], capture_output=True, text=True, timeout=240).stderr
        assert picture.is_file(), said
        # What the browser says of its own accord on a busy machine is not the page's.
        console = [each for each in said.splitlines() if ":CONSOLE" in each and "Slow network is detected" not in each]
        return numpy.asarray(Image.open(picture).convert("RGB")), console

    return render


@pytest.fixture(scope="module", params=[(1200, 6000), (390, 12000)], ids="{0[0]} px wide".format)
def shown(request, page, render):
    """The size of a window, and what the page looks like in it."""
    return request.param, *render(f"file://{page}", *request.param)


def test_the_page_fills_the_window(shown):
    (width, height), picture, _ = shown
    assert picture.shape == (height, width, 3)


def test_the_page_asks_nothing_of_the_network_and_says_nothing_in_the_console(shown):
    assert not shown[2]


def test_the_page_shows_images(shown):
    # A number for each colour: quicker than numpy's unique rows.
    colours, counts = numpy.unique(shown[1] @ numpy.array([1 << 16, 1 << 8, 1]), return_counts=True)
    assert len(colours) > 1000
    assert counts.max() < 0.95 * counts.sum(), "almost all of it is of one colour"


@pytest.mark.parametrize("colour", SPLIT_COLOURS, ids=str)
def test_each_split_has_its_colour(shown, colour):
    assert (shown[1] == colour).all(axis=2).sum() > 100


def test_nothing_is_wider_than_the_window(shown):
    """The right margin is white all the way down."""
    assert (shown[1][:, -4:] == 255).all()


def test_a_click_on_a_sample_shows_it_over_the_window_on_dark(page, within, render):
    sample = next(link for link in within if not link.startswith("#of-"))
    picture, console = render(f"file://{page}{sample}", 1201, 800)
    assert not console
    corners = picture[[4, 4, -5, -5], [4, -5, 4, -5]]
    middle = picture[300:500, 500:700].reshape(-1, 3)
    assert (corners < 80).all() and len(numpy.unique(middle, axis=0)) > 100
