// Draws what gelsim tells of the sheet. All texts of jobs, labels and errors are put into the page as text, never as HTML.

const get = (id) => document.getElementById(id);

const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

/** The last news of the sheet. */
let sheet = { revision: 0, samples: [] };
/** The tiles by the number of their sample. */
const tiles = new Map();
/** Number of the sample whose label is shown, and of the one at full size. */
let chosen = null;
let enlarged = null;
/** Whether the pictures before the last change are shown. */
let isBefore = false;
/** For each sample whose label was shown: its revision, its facts, and those before. */
const known = new Map();

const sampleOf = (index) => sheet.samples.find((sample) => sample.index === index);
const describe = (sample) => `#${sample.index} ${sample.caption}`;

// --- Pictures

/** Builds or updates the rows of pictures of a sample below an element; `width` is the most that a picture needs, px. */
const drawRows = (parent, sample, width) => {
  const shape = JSON.stringify(sample.rows.map((row) => row.panels.map((panel) => [panel.width, panel.height])));
  if (parent.dataset.shape !== shape) {
    parent.dataset.shape = shape;
    const panelOf = ({ width, height }) =>
      make("span", { className: "panel" }, make("span", { className: "heading" }), make("img", { width, height, draggable: false }));
    const rowOf = (row) => {
      const built = make("span", { className: "row" }, make("span", { className: "name" }), ...row.panels.map(panelOf));
      built.style.setProperty("--columns", row.panels.length);
      return built;
    };
    parent.replaceChildren(...sample.rows.map(rowOf));
  }
  sample.rows.forEach((row, y) => {
    const [name, ...panels] = parent.children[y].children;
    name.textContent = row.label;
    name.hidden = !row.label;
    row.panels.forEach((panel, x) => {
      const [heading, image] = panels[x].children;
      heading.textContent = heading.title = panel.heading;
      image.alt = `${panel.heading || row.label || "picture"} of sample ${describe(sample)}`;
      const address = `${isBefore ? "before" : "picture"}/${sample.index}/${y}/${x}?v=${panel.version}&width=${width}`;
      if (image.getAttribute("src") !== address) image.src = address;
    });
  });
};

/** How many pixels the pictures of tiles need, in steps, so that not every size asks for new ones. */
const tileWidth = () => Math.ceil((get("size").value * devicePixelRatio) / 120) * 120;

const makeTile = (index) => {
  const rows = make("span", { className: "rows" });
  const caption = make("span");
  const split = make("span", { className: "muted" });
  const health = make("span", { className: "bad" });
  const button = make("button", { type: "button", className: "tile" }, rows, make("span", { className: "text" }, caption, split), health);
  button.dataset.index = index;
  return { item: make("li", {}, button), button, rows, caption, split, health };
};

const drawTile = (sample) => {
  if (!tiles.has(sample.index)) tiles.set(sample.index, makeTile(sample.index));
  const tile = tiles.get(sample.index);
  tile.button.classList.toggle("old", !sample.is_current);
  tile.button.classList.toggle("chosen", sample.index === chosen);
  tile.split.textContent = `${sample.split} #${sample.index}`;
  tile.caption.textContent = sample.caption;
  tile.health.textContent = sample.health;
  tile.health.hidden = !sample.health;
  if (sample.rows.length) {
    drawRows(tile.rows, sample, tileWidth());
  } else {
    delete tile.rows.dataset.shape;
    tile.rows.replaceChildren(make("span", { className: "waiting", textContent: sheet.is_busy ? "rendering" : "not rendered" }));
  }
  return tile.item;
};

const drawTiles = () => {
  const items = sheet.samples.map(drawTile);
  const list = get("sheet");
  // A list that is put together anew would lose the place of the keyboard.
  if (items.length !== list.children.length || items.some((item, at) => item !== list.children[at])) list.replaceChildren(...items);
  const numbers = new Set(sheet.samples.map((sample) => sample.index));
  for (const index of tiles.keys()) if (!numbers.has(index)) tiles.delete(index);
  for (const index of known.keys()) if (!numbers.has(index)) known.delete(index);
};

// --- The label

const lineOf = (name, value, was) => {
  if (!value) return make("tr", {}, make("th", { textContent: name, colSpan: 2, scope: "colgroup" }));
  const cell = make("td", { textContent: value });
  if (was !== undefined && was !== value) cell.append(make("span", { className: "was", textContent: `was ${was}` }));
  return make("tr", {}, make("th", { textContent: name, scope: "row" }), cell);
};

/** Names and values of facts; headings make the names of the lines below them differ. */
const valuesOf = (facts) => {
  let heading = "";
  return new Map(facts.map(({ name, value }) => {
    if (!value) heading = name;
    return [`${heading}/${name}`, value];
  }));
};

const drawLabel = async () => {
  const sample = sampleOf(chosen);
  if (!sample?.rows.length) return;
  let state = known.get(sample.index);
  if (state?.revision !== sample.revision) {
    const answer = await fetch(`label/${sample.index}?v=${sample.revision}`);
    if (!answer.ok) return;
    const label = await answer.json();
    state = { revision: sample.revision, label, before: state ? valuesOf(state.label.facts) : new Map() };
    known.set(sample.index, state);
    // Another sample may have been chosen meanwhile.
    if (sample.index !== chosen) return;
  }
  const { label, before } = state;
  get("title").textContent = describe(sample);
  get("hint").hidden = true;
  get("known").hidden = false;
  const keys = [...valuesOf(label.facts).keys()];
  get("facts").replaceChildren(...label.facts.map(({ name, value }, at) => lineOf(name, value, before.get(keys[at]))));
  const effects = (ran) => label.effects.filter((effect) => effect.ran === ran).map(({ name, reason }) => lineOf(name, reason || "–"));
  get("ran").replaceChildren(...effects(true));
  get("idle").replaceChildren(...effects(false));
  get("json").textContent = JSON.stringify(label.json, null, 2);
};

const choose = (index) => {
  if (index === chosen) return;
  tiles.get(chosen)?.button.classList.remove("chosen");
  chosen = index;
  tiles.get(chosen)?.button.classList.add("chosen");
  drawLabel().catch(() => {});
};

// --- Full size

const drawLarge = () => {
  const sample = sampleOf(enlarged);
  if (!sample?.rows.length) return get("large").close();
  get("caption").textContent = describe(sample);
  drawRows(get("pictures"), sample, Math.max(...sample.rows.flatMap((row) => row.panels.map((panel) => panel.width))));
};

const enlarge = (index) => {
  if (!sampleOf(index)?.rows.length) return;
  enlarged = index;
  choose(index);
  drawLarge();
  if (!get("large").open) get("large").showModal();
};

/** Shows the sample so many places further on. */
const step = (by) => {
  const shown = sheet.samples.filter((sample) => sample.rows.length);
  const at = shown.findIndex((sample) => sample.index === enlarged);
  enlarge(shown[(at + by + shown.length) % shown.length].index);
};

// --- News

const drawStatus = () => {
  const done = sheet.samples.filter((sample) => sample.is_current).length;
  const count = sheet.samples.length;
  const samples = count === 1 ? "sample" : "samples";
  const status = get("status");
  status.classList.toggle("bad", Boolean(sheet.problem));
  if (sheet.problem) status.textContent = "the job is broken: these are its last samples";
  else if (sheet.is_busy) status.textContent = `rendering ${done} of ${count} ${samples}`;
  else status.textContent = `${count} ${samples} in ${sheet.seconds.toFixed(sheet.seconds < 10 ? 1 : 0)} s`;
  document.title = `${sheet.problem ? "✗ " : ""}${sheet.job} – gelsim preview`;
};

const draw = () => {
  get("job").textContent = sheet.job;
  drawStatus();
  for (const [id, text] of [["problem", sheet.problem], ["notes", sheet.notes]]) {
    const box = get(id);
    const place = box.querySelector("pre") ?? box;
    if (place.textContent !== text) place.textContent = text;
    box.hidden = !text;
  }
  get("before").hidden = !sheet.samples.some((sample) => sample.has_before);
  drawTiles();
  if (get("large").open) drawLarge();
  drawLabel().catch(() => {});
};

const showBefore = (wanted) => {
  if (isBefore === wanted || get("before").hidden) return;
  isBefore = wanted;
  get("before").classList.toggle("held", wanted);
  draw();
};

const follow = async () => {
  for (;;) {
    try {
      const answer = await fetch(`sheet?after=${sheet.revision}`);
      if (!answer.ok) throw new Error(answer.statusText);
      sheet = await answer.json();
      draw();
    } catch {
      get("status").textContent = "gelsim has ended or cannot be reached: start it again, and open the new address";
      get("status").classList.add("bad");
      await new Promise((resolve) => setTimeout(resolve, 1000));
      sheet.revision = 0;
    }
  }
};

// --- Pointer and keyboard

/** Whoever goes to the label passes over other tiles: those do not count. */
const PASSING_MS = 120;
let passing;
const tileAt = (event) => event.target.closest?.(".tile");

get("sheet").addEventListener("pointerover", (event) => {
  clearTimeout(passing);
  const tile = tileAt(event);
  if (tile) passing = setTimeout(choose, PASSING_MS, Number(tile.dataset.index));
});
get("sheet").addEventListener("pointerleave", () => clearTimeout(passing));
get("sheet").addEventListener("focusin", (event) => {
  const tile = tileAt(event);
  if (tile?.matches(":focus-visible")) choose(Number(tile.dataset.index));
});
get("sheet").addEventListener("click", (event) => {
  const tile = tileAt(event);
  if (tile) enlarge(Number(tile.dataset.index));
});
get("previous").addEventListener("click", () => step(-1));
get("next").addEventListener("click", () => step(1));
get("close").addEventListener("click", () => get("large").close());
get("large").addEventListener("click", (event) => event.target === get("large") && get("large").close());
get("large").addEventListener("close", () => tiles.get(enlarged)?.button.focus());
get("large").addEventListener("keydown", (event) => {
  const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (by) {
    event.preventDefault();
    step(by);
  }
});
get("before").addEventListener("pointerdown", () => showBefore(true));
addEventListener("pointerup", () => showBefore(false));
addEventListener("keydown", (event) => event.key.toLowerCase() === "b" && !event.ctrlKey && !event.metaKey && showBefore(true));
addEventListener("keyup", (event) => event.key.toLowerCase() === "b" && showBefore(false));
addEventListener("blur", () => showBefore(false));
const resize = () => {
  get("sheet").style.setProperty("--size", `${get("size").value}px`);
  drawTiles();
};
get("size").addEventListener("input", resize);
resize();
follow();
