"""Measures the figures of the pages again, and says which of them are no longer true.

    python tests/bench/figures.py GELSIM [PAGE...]
    python tests/bench/figures.py --list [PAGE...]

Old figures are read from README.md and docs/**/*.md, new ones from what the command beside them prints or writes; which belong
together says measured.py. Each gets a line: page, what it is, old, new, how far it is off, how far it may be. Exit status 1 if an
error or a ratio is beyond that, or a test or command fails. Times are printed and nothing else.

A figure may be off by its tolerance (2 % of it, unless measured.py says otherwise) and half a unit of the last digit that the page
gives. One that the page calls a bound ("within", "at most") may be lower by any amount.

The figures of docs/evidence/accuracy.md need NumPy and Pillow, those of other simulators OpenCV; without these they are left out.

    --list                    says what would be measured; needs neither program nor cargo
    --update                  writes new figures into the pages in place of those that are beyond, with as many digits
    --executable TARGET=PATH  takes PATH for the test executable `library` or `lib`, in place of what cargo builds
"""

import argparse
import importlib.util
import json
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable

ROOT = Path(__file__).resolve().parents[2]
ERROR, BOUND, TIME = "error", "bound", "time"
NUMBER = r"[+-]?(?:\d{1,3}(?:,\d{3})+(?!\d)|\d+)(?:\.\d+)?(?:e[+-]?\d+)?"
HOLES = {"{}": ERROR, "{<}": BOUND, "{ms}": TIME}
COLUMNS = {"e": ERROR, "b": BOUND, "t": TIME}


class Stale(Exception):
    """A page, a command's output and measured.py do not fit each other."""


def number(text):
    return float(text.replace(",", ""))


def collapsed(text):
    return " ".join(text.split())


def regex(template):
    """A template as a regular expression: a number for each hole, anything within a line for `{*}`, any white space for a blank."""
    parts = []
    for part in re.split(r"(\{[<*]?\}|\{ms\}|\s+)", template):
        if part in HOLES:
            parts.append(f"({NUMBER})")
        else:
            parts.append(r"[^\n]*?" if part == "{*}" else r"\s+" if part.isspace() else re.escape(part))
    return re.compile("".join(parts))


def scan(text, template):
    """The numbers in the template's holes, for each place of the text that it fits."""
    return [[number(group) for group in match.groups()] for match in regex(template).finditer(text)]


@dataclass(frozen=True)
class Old:
    """A figure as it stands in a page."""

    what: str
    text: str
    start: int
    kind: str

    @property
    def value(self):
        return number(self.text)

    @property
    def unit(self):
        """What one more in the last digit would be."""
        digits, _, exponent = self.text.partition("e")
        return 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))

    def allowed(self, tolerance):
        return (tolerance * abs(self.value) if self.kind == ERROR else 0.0) + 0.5001 * self.unit

    def holds(self, new, tolerance):
        off = new - self.value if self.kind == BOUND else abs(new - self.value)
        return self.kind == TIME or off <= self.allowed(tolerance)

    def written(self, new):
        """A new figure as the page writes the old one; bounds are rounded up."""
        digits, power, _ = self.text.partition("e")
        decimals = len(digits.partition(".")[2])
        sign = "+" if self.text.startswith("+") else ""
        if power:
            mantissa, _, exponent = f"{new:{sign}.{decimals}e}".partition("e")
            return f"{mantissa}e{int(exponent)}"
        if self.kind == BOUND:
            new = math.ceil(new / self.unit - 1e-9) * self.unit
        text = f"{new:{sign}{',' if ',' in digits else ''}.{decimals}f}"
        return text.replace("-", "") if number(text) == 0.0 else text


@dataclass(frozen=True)
class Sentence:
    """Words that stand once in a page, with holes for figures: `{}` an error or a ratio, `{<}` a bound, `{ms}` a time."""

    template: str

    def read(self, text):
        found = list(regex(self.template).finditer(text))
        if len(found) != 1:
            raise Stale(f"stands {len(found)} times instead of once: {self.template}")
        kinds = [HOLES[hole] for hole in re.findall(r"\{<?\}|\{ms\}", self.template)]
        (match,) = found
        figures = [Old(self.around(text, match, k), match[k], match.start(k), kind) for k, kind in enumerate(kinds, 1)]
        return {"": [[figure] for figure in figures]}

    @staticmethod
    def around(text, match, k):
        """Some whole words of the sentence before and after a figure."""
        before = text[match.start() : match.start(k)].split()
        after = text[match.end(k) : match.end()].split()
        return " ".join([*before[-9:], "#", *after[:5]]).strip(" |")


@dataclass(frozen=True)
class Table:
    """The first table after words that stand once in a page.

    `columns` has a letter for each column: `l` names the row, `e` holds errors or ratios, `b` bounds, `t` times, `-` is not
    measured. A cell may hold several figures. A name that occurs again gets a number: `a ball (2)`. `name` shortens it.
    """

    after: str
    columns: str
    name: Callable[[str], str] = collapsed

    def read(self, text):
        if text.count(self.after) != 1:
            raise Stale(f"stands {text.count(self.after)} times instead of once: {self.after}")
        # Words of the table's own head may name it.
        begin = text.rfind("\n", 0, text.index(self.after)) + 1
        lines = re.compile(r"^\|.*\|$", re.M).finditer(text, begin)
        head, rule, *rows = next(self.blocks(lines), [None, None])
        kinds = self.columns.split()
        if not rows or head[0].strip("|").count("|") + 1 != len(kinds):
            raise Stale(f"no table of {len(kinds)} columns after: {self.after}")
        titles = [title.strip() for title in head[0].strip("|").split("|")]
        # Where a page has several tables of the same head, words before it tell them apart.
        table = "" if self.after.startswith("|") else f"{self.after.strip('.( ')}: "
        found, seen = {}, Counter()
        for row in rows:
            cells = list(re.finditer(r"(?<=\|)[^|]*(?=\|)", row[0]))
            plain = {kind: cell[0] for kind, cell in zip(kinds, cells)}
            label = self.name(collapsed(re.sub(r"[`*]", "", plain["l"])))
            seen[label] += 1
            label = label if seen[label] == 1 else f"{label} ({seen[label]})"
            found[label] = [
                [
                    Old(f"{table}{label}, {title}", figure[0], row.start() + cell.start() + figure.start(), COLUMNS[kind])
                    for figure in re.finditer(NUMBER, cell[0])
                ]
                for kind, cell, title in zip(kinds, cells, titles)
                if kind in COLUMNS
            ]
        return {label: cells for label, cells in found.items() if any(cells)}

    @staticmethod
    def blocks(lines):
        block = []
        for line in lines:
            if block and line.start() != block[-1].end() + 1:
                yield block
                block = []
            block.append(line)
        if block:
            yield block

    def values(self, text):
        """The figures of such a table in a command's output."""
        return {label: [[old.value for old in cell] for cell in cells] for label, cells in self.read(text).items()}


@dataclass(frozen=True)
class Output:
    """What a command, or a test that it runs, has printed; and the folder in which it ran."""

    text: str
    folder: Path = ROOT


@dataclass(frozen=True)
class Figures:
    """Figures of a page, and how they come out of the command beside them.

    `new` makes of the output a list for a sentence (in the order of its holes), for a table a list of cells for each row, or None
    for rows that this command does not measure. Of a command that runs tests only `test` is run, a test's name or how several
    begin. `fill` stands for the command's placeholders; `needs` are modules without which it is left out.
    """

    page: str
    command: str
    place: Sentence | Table
    new: Callable[[Output], list | dict]
    test: str = ""
    tolerance: float = 0.02
    fill: dict = field(default_factory=dict)
    needs: tuple = ()

    @property
    def line(self):
        """The command as it is run."""
        words = collapsed(self.command)
        for placeholder, value in self.fill.items():
            words = words.replace(placeholder, value)
        return words

    @property
    def target(self):
        """The test executable that the command runs, if it runs one: `library`, `program` or `lib`."""
        match = re.search(r"\bcargo test .*--(?:(lib)\b|test (\w+))", self.command)
        return match and (match[1] or match[2])

    @property
    def thorough(self):
        return self.command.startswith("GELSIM_THOROUGH=1 ")

    def missing(self):
        return next((module for module in self.needs if importlib.util.find_spec(module) is None), None)

    def old(self, text):
        if self.command not in collapsed(text):
            raise Stale(f"the command is not there: {self.command}")
        match = re.search(r"--(?:lib|test \w+) ([\w:]+)", self.command)
        if match and match[1] not in self.test:
            raise Stale(f"{self.command} does not run {self.test}")
        return self.place.read(text)

    def pairs(self, text, output):
        """Each figure with its new value, which is None where this command does not measure it."""
        old, new = self.old(text), self.new(output)
        new = new if isinstance(new, dict) else {"": new}
        for label, cells in old.items():
            if label not in new:
                raise Stale(f"nothing measured for the row: {label}")
            values = new[label]
            if values is not None and len(values) != len(cells):
                raise Stale(f"{len(values)} values for {len(cells)} figures: {label or self.place}")
            for index, cell in enumerate(cells):
                value = None if values is None else values[index]
                several = value if isinstance(value, list) else [value] * len(cell)
                if len(several) != len(cell):
                    raise Stale(f"{len(several)} values for {len(cell)} figures: {cell[0].what if cell else label}")
                yield from zip(cell, several)


def page_path(page):
    return ROOT / ("README.md" if page == "README" else f"docs/{page}.md")


class Runner:
    """Runs each command once: tests together, an executable for each target, everything else in a folder of its own."""

    def __init__(self, program, executables, chosen):
        self.program, self.executables = Path(program).resolve(), executables
        self.tests, self.commands, self.printed = defaultdict(set), {}, {}
        self.failed = []
        for figures in chosen:
            if figures.target:
                self.tests[figures.target, figures.thorough].add(figures.test)

    def output(self, figures):
        if not figures.target:
            if figures.line not in self.commands:
                self.commands[figures.line] = self.run(figures.line)
            return self.commands[figures.line]
        key = figures.target, figures.thorough
        if key not in self.printed:
            self.printed[key] = self.run_tests(*key)
        chosen = {name: text for name, text in self.printed[key].items() if name.startswith(figures.test)}
        if not chosen:
            raise Stale(f"no test {figures.test}")
        return Output("\n".join(chosen.values()))

    def run(self, line):
        words = [str(self.program) if word in ("GELSIM", "target/release/gelsim") else word for word in shlex.split(line)]
        words[0] = {"gelsim": str(self.program), "python": sys.executable, "python3": sys.executable}.get(words[0], words[0])
        folder = ROOT
        if words[0] != "cargo":
            # What it writes stays out of the working tree, whose files it finds by the names that the page has.
            folder = Path(tempfile.mkdtemp(dir=self.place.name))
            for name in ("configs", "objects", "tests", "docs"):
                (folder / name).symlink_to(ROOT / name)
        return Output(self.started(line, words, folder), folder)

    def run_tests(self, target, thorough):
        if target not in self.executables:
            self.executables.update(built())
        words = [*sorted(self.tests[target, thorough]), "--nocapture", "--test-threads=1"]
        environment = {**os.environ, **({"GELSIM_THOROUGH": "1"} if thorough else {})}
        what = (
            f"{len(self.tests[target, thorough])} filters of the test executable `{target}`{', thorough' if thorough else ''}"
        )
        printed = "".join(self.started(what, [program, *words], ROOT, environment) for program in self.executables[target])
        # A test's name, what it prints, and how it ended.
        tests = re.split(r"(?m)^test (\S+) \.\.\. ", printed)[1:]
        ended = re.compile(r"(.*?)^(?:ok|FAILED)$", re.M | re.S)
        return {name: (ended.match(text) or [None, text])[1] for name, text in zip(tests[::2], tests[1::2])}

    def started(self, what, words, folder, environment=None):
        begun = time.monotonic()
        done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
        print(f"-- {what[:110]}: {time.monotonic() - begun:.0f} s", flush=True)
        if done.returncode != 0:
            failures = re.findall(r"(?m)^    (\S+::\S+)$", done.stdout)
            self.failed += sorted(set(failures)) or [f"{what}: {done.stderr.strip()[-600:]}"]
        return done.stdout

    def __enter__(self):
        self.place = tempfile.TemporaryDirectory()
        return self

    def __exit__(self, *_):
        self.place.cleanup()


def built():
    """The test executables by the name of their target, `lib` for all crates, which cargo compiles if it must."""
    command = ["cargo", "test", "--release", "--locked", "--no-run", "--message-format", "json", "--lib", "--test", "library"]
    done = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    found = defaultdict(list)
    for message in map(json.loads, done.stdout.splitlines()):
        if message.get("executable") and message["profile"]["test"]:
            kind = message["target"]["kind"]
            found[message["target"]["name"] if kind == ["test"] else "lib"].append(message["executable"])
    return found


def short(value):
    return f"{value:.4g}"


def compare(chosen, runner, update):
    """Prints a line for each figure; how many there were of each outcome."""
    counts, changed = Counter(), defaultdict(dict)
    for figures in chosen:
        name = figures.page
        if figures.missing():
            print(f"{name}: left out, no module {figures.missing()}: {figures.line}")
            continue
        text = page_path(figures.page).read_text()
        try:
            for old, new in figures.pairs(text, runner.output(figures)):
                if new is None:
                    counts["not measured"] += 1
                    continue
                holds = old.holds(new, figures.tolerance)
                outcome = "time" if old.kind == TIME else "ok" if holds else "BEYOND"
                counts[outcome] += 1
                off = "" if old.kind == TIME else f"off {short(new - old.value)}, may {short(old.allowed(figures.tolerance))}"
                bound = "at most " if old.kind == BOUND else ""
                print(f"{name}: {old.what}: old {bound}{old.text}, new {short(new)}, {off or 'a time'}: {outcome}")
                if not holds:
                    changed[figures.page][old.start] = (old, old.written(new))
        except (Stale, LookupError, ValueError, OSError) as why:
            counts["STALE"] += 1
            print(f"{name}: STALE: {type(why).__name__}: {why} [{figures.line}]")
    if update:
        for page, figures in changed.items():
            text = page_path(page).read_text()
            for start, (old, new) in sorted(figures.items(), reverse=True):
                text = text[:start] + new + text[start + len(old.text) :]
            page_path(page).write_text(text)
    return counts


def listed(chosen):
    counts = Counter()
    code = "".join(file.read_text() for folder in ("src", "tests") for file in sorted((ROOT / folder).rglob("*.rs")))
    names = " ".join(re.findall(r"\b(?:fn|mod) (\w+)", code))
    for figures in chosen:
        try:
            rows = figures.old(page_path(figures.page).read_text()).values()
            if figures.test and f" {figures.test.split('::')[-1]}" not in names:
                raise Stale(f"no test {figures.test}")
        except Stale as why:
            counts["STALE"] += 1
            print(f"{figures.page}: STALE: {why}")
            continue
        old = [figure for cells in rows for cell in cells for figure in cell]
        kinds = Counter(figure.kind for figure in old)
        test = f" [{figures.test}]" if figures.test else ""
        count = ", ".join(f"{count} {kind}{'s' * (count > 1)}" for kind, count in kinds.items())
        print(f"{figures.page}: {count}: {figures.line}{test}: {old[0].what}")
    return counts


def main():
    from measured import MEASURED

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="GELSIM [PAGE...]")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--update", action="store_true")
    parser.add_argument("--executable", action="append", default=[], metavar="TARGET=PATH")
    arguments = parser.parse_args()
    program, pages = (None, arguments.names) if arguments.list else (arguments.names[:1], arguments.names[1:])
    if program == []:
        sys.exit(__doc__)
    pages = [page.removeprefix("docs/").removesuffix(".md") for page in pages]
    unknown = set(pages) - {figures.page for figures in MEASURED}
    if unknown:
        sys.exit(f"nothing is measured of {', '.join(sorted(unknown))}")
    chosen = [figures for figures in MEASURED if not pages or figures.page in pages]

    begun = time.monotonic()
    failed = []
    if arguments.list:
        counts = listed(chosen)
    else:
        executables = {target: [path] for target, path in (pair.split("=", 1) for pair in arguments.executable)}
        with Runner(program[0], executables, chosen) as runner:
            counts = compare(chosen, runner, arguments.update)
            failed = runner.failed
        print(
            f"\n{counts['ok'] + counts['BEYOND']} errors and ratios measured, {counts['BEYOND']} beyond; {counts['time']} times; "
            f"{counts['not measured']} in the same rows that no command measures; {counts['STALE']} places to look at; "
            f"{time.monotonic() - begun:.0f} s"
        )
    for command in failed:
        print(f"FAILED: {command}")
    sys.exit(1 if counts["BEYOND"] or counts["STALE"] or failed else 0)


if __name__ == "__main__":
    # measured.py takes the classes from this module, under its own name.
    sys.modules["figures"] = sys.modules["__main__"]
    main()
