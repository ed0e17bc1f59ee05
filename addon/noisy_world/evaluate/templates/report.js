"use strict";
// What the page does. Names and other texts from outside are only ever texts here: they become text nodes, never markup.

const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const MOST_OPENED = 12; // runs that a dialog shows of a cell

const make = (name, attributes = {}, ...children) => {
  const [space, kind] = name.startsWith("svg:") ? ["http://www.w3.org/2000/svg", name.slice(4)] : [null, name];
  const element = space ? document.createElementNS(space, kind) : document.createElement(kind);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children.filter((child) => child !== null));
  return element;
};

// --- the data, which are compressed ---

const unpack = async () => {
  const bytes = Uint8Array.from(atob(document.getElementById("data").textContent), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).json();
};

// --- figures ---

const showFigures = (figures) => {
  const phone = matchMedia("(max-width: 40rem)");
  const images = [...document.querySelectorAll("img[data-figure]")];
  const draw = () => {
    for (const image of images) {
      const shapes = figures[image.dataset.figure];
      const svg = (phone.matches && shapes[1]) || shapes[0];
      if (image.src) URL.revokeObjectURL(image.src);
      image.src = URL.createObjectURL(new Blob([svg], { type: "image/svg+xml" }));
    }
  };
  phone.addEventListener("change", draw);
  draw();
};

// --- tables: a click on a heading sorts, words filter; long ones are filled when they are opened ---

const fill = (table, content) => {
  const rows = content.rows.map((cells) => make("tr", {}, ...cells.map(([text, value], column) => {
    const cell = make("td", content.numeric[column] ? { class: "n" } : {}, text);
    if (value !== text) cell.dataset.v = value;
    return cell;
  })));
  table.tBodies[0].replaceChildren(...rows);
};

const sortable = (table) => {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const numeric = head.classList.contains("n");
    head.querySelector("button").addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      const body = table.tBodies[0];
      const value = (row) => row.cells[column].dataset.v ?? row.cells[column].textContent;
      const rows = [...body.rows].sort((a, b) => {
        const [x, y] = [value(a), value(b)];
        if (x === "" || y === "") return (x === "") - (y === ""); // what has no value stays last
        const order = numeric ? Number(x) - Number(y) : x.localeCompare(y, "en", { numeric: true });
        return up ? order : -order;
      });
      body.append(...rows);
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
    });
  });
};

const FEWEST_FILTERED = 8;

const filterable = (table, count) => {
  if (count < FEWEST_FILTERED) return;
  const field = make("input", { type: "search", placeholder: "only rows with ...", "aria-label": "only rows with these words" });
  const told = make("output", {});
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const row of table.tBodies[0].rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
      shown += !row.hidden;
    }
    told.textContent = words.length ? `${shown} of ${table.tBodies[0].rows.length} rows` : "";
  });
  table.parentElement.before(make("p", { class: "filter" }, field, told));
};

const openTables = (data) => {
  for (const table of document.querySelectorAll("table.sortable")) {
    const content = data.tables[table.dataset.name];
    sortable(table);
    filterable(table, content ? content.rows.length : table.tBodies[0].rows.length);
    const ready = () => {
      if (content && !table.tBodies[0].rows.length) fill(table, content);
      if (table.dataset.name === "runs") openRows(table, data);
    };
    const folded = table.closest("details");
    if (folded) folded.addEventListener("toggle", ready, { once: true });
    else ready();
  }
};

// The table of runs and the runs of the data are in one order.
const openRows = (table, data) => [...table.tBodies[0].rows].forEach((row, index) => {
  const button = make("button", { type: "button", class: "open" }, ...row.cells[0].childNodes);
  button.addEventListener("click", () => show(data, [data.runs[index]]));
  row.cells[0].replaceChildren(button);
});

// --- runs: paths over the truth, errors over time, the frame where it went wrong ---

const metres = (value) => (value === null ? "none" : value < 0.1 ? `${+(1e3 * value).toPrecision(3)} mm` : `${value} m`);
const named = (run) => `${run.system}, ${run.scene}/${run.setting}, seed ${run.seed}, run ${run.repeat}`;
const said = (run) => {
  const parts = [run.failed ? run.ended : `ATE ${metres(run.ate_m)}`];
  if (run.over_clean !== null && !run.failed) parts.push(`× ${run.over_clean} its clean error`);
  if (run.incomplete) parts.push(`${Math.round(100 * run.tracked)} % of the frames tracked`);
  return parts.join(", ");
};

const pairs = (flat) => flat.reduce((found, value, place) => {
  if (place % 2) found[found.length - 1].push(value);
  else found.push([value]);
  return found;
}, []);

const line = (points, colour, width) => {
  let before = false;
  const text = points.map(([x, y]) => {
    const known = x !== null && y !== null;
    const step = known ? `${before ? "L" : "M"}${x} ${y}` : "";
    before = known;
    return step;
  }).join("");
  return make("svg:path", { d: text, fill: "none", stroke: colour, "stroke-width": width, "vector-effect": "non-scaling-stroke" });
};

const pathsOf = (data, runs) => {
  const truth = data.sequences[runs[0].sequence];
  if (!truth?.path) return null;
  const drawn = runs.filter((run) => run.path);
  const every = [truth.path, ...drawn.map((run) => run.path)].map(pairs);
  const known = every.flat().filter(([x]) => x !== null);
  const [xs, ys] = [known.map(([x]) => x), known.map(([, y]) => y)];
  const [left, bottom] = [Math.min(...xs), Math.min(...ys)];
  const [width, height] = [Math.max(...xs) - left, Math.max(...ys) - bottom];
  const size = Math.max(width, height, 1);
  const placed = every.map((points) => points.map(([x, y]) => (x === null ? [null, null] : [x - left, height - (y - bottom)])));
  const margin = 0.04 * size;
  const box = `${-margin} ${-margin} ${width + 2 * margin} ${height + 2 * margin}`;
  const picture = make("svg:svg", { viewBox: box, class: "paths", role: "img", "aria-label": "paths from above, the true one in grey" });
  picture.append(line(placed[0], "#9aa3ab", 5), make("svg:circle", { cx: placed[0][0][0], cy: placed[0][0][1], r: 0.02 * size, fill: "#9aa3ab" }));
  drawn.forEach((_, index) => picture.append(line(placed[index + 1], COLOURS[index % COLOURS.length], 1.6)));
  const caption = `The paths from above, world ${truth.axes[0]} and ${truth.axes[1]}, ${metres(+(size / 1e3).toPrecision(3))} across: the true one in grey, its beginning as a dot.`;
  return make("figure", {}, picture, make("figcaption", {}, caption));
};

// Round times from 0 to the end, at most five of them.
const timesTo = (end) => {
  const tenth = 10 ** Math.floor(Math.log10(end / 4));
  const step = tenth * [1, 2, 5, 10].find((times) => times * tenth >= end / 4);
  return Array.from({ length: Math.floor(end / step) + 1 }, (_, index) => +(index * step).toPrecision(3));
};

const errorsOf = (runs) => {
  const drawn = runs.filter((run) => run.error_m?.some((value) => value !== null));
  if (!drawn.length) return null;
  const values = drawn.flatMap((run) => run.error_m.filter((value) => value > 0));
  const [low, high] = [Math.floor(Math.log10(Math.min(...values, 1))), Math.ceil(Math.log10(Math.max(...values, 1e-6)))];
  const [width, height, left] = [window.innerWidth < 640 ? 320 : 640, 240, 64]; // so that words keep their size
  const y = (value) => 8 + (height - 32) * (high - Math.log10(Math.max(value, 10 ** low))) / Math.max(1, high - low);
  const picture = make("svg:svg", { viewBox: `0 0 ${width} ${height}`, class: "errors", role: "img", "aria-label": "errors over time" });
  for (let power = low; power <= high; power += 1) {
    picture.append(make("svg:line", { x1: left, x2: width, y1: y(10 ** power), y2: y(10 ** power), stroke: "#d7dce1" }));
    picture.append(make("svg:text", { x: left - 6, y: y(10 ** power) + 4, "text-anchor": "end" }, metres(10 ** power)));
  }
  const end = Math.max(...drawn.map((run) => run.end_s), 1e-3);
  drawn.forEach((run, index) => {
    const step = run.end_s / Math.max(1, run.error_m.length - 1);
    const at = (place) => left + (width - left) * (place * step) / end;
    const colour = COLOURS[index % COLOURS.length];
    picture.append(line(run.error_m.map((value, place) => (value === null ? [null, null] : [at(place), y(value)])), colour, 1.5));
    const half = (width - left) * step / end / 2;
    const lost = run.error_m.flatMap((value, place) => (value === null ? [at(place) - half, at(place) + half, null] : []));
    picture.append(line(lost.map((x) => (x === null ? [null, null] : [x, height - 20 + 3 * index])), colour, 2.5));
  });
  for (const time of timesTo(end)) {
    const place = left + (width - left) * time / end;
    const anchor = place > width - 24 ? "end" : "middle";
    picture.append(make("svg:text", { x: place, y: height - 2, "text-anchor": anchor }, `${time} s`));
  }
  const caption = "The largest error of the frames between two points, over time; a gap, with a line below, is where no frame has a pose.";
  return make("figure", {}, picture, make("figcaption", {}, caption));
};

const framesOf = (data, runs) => runs.filter((run) => run.picture !== undefined).slice(0, MOST_OPENED).map((run) => make(
  "figure", {},
  make("img", { src: `data:image/jpeg;base64,${data.frames[run.picture]}`, alt: `frame ${run.frame}` }),
  make("figcaption", {}, `${named(run)}: frame ${run.frame}; it ${run.worst}. On the right what the system was given, on the left the clean frame, if there is one.`),
));

const legend = (runs) => make("ul", { class: "legend" }, ...runs.map((run, index) => {
  const mark = make("span", { style: `background: ${COLOURS[index % COLOURS.length]}` });
  return make("li", {}, mark, `${named(run)}: ${said(run)}`);
}));

const ofRuns = (data, runs) => {
  const shown = runs.slice(0, MOST_OPENED);
  const bySequence = Map.groupBy ? Map.groupBy(shown, (run) => run.sequence) : shown.reduce(
    (found, run) => found.set(run.sequence, [...(found.get(run.sequence) ?? []), run]), new Map());
  const parts = [...bySequence.values()].map((group) => make("section", {}, legend(group), make("div", { class: "beside" }, ...[pathsOf(data, group), errorsOf(group)].filter(Boolean))));
  const frames = framesOf(data, shown);
  if (runs.length > shown.length) parts.unshift(make("p", {}, `${shown.length} of ${runs.length} runs, the worst first; the table of all runs opens each.`));
  if (!shown.some((run) => run.path)) parts.push(make("p", { class: "soft" }, "There are no paths or frames: none was estimated, or this is a record, and they are in the folders of its pieces."));
  return [...parts, frames.length ? make("div", { class: "frames" }, ...frames) : null].filter(Boolean);
};

const worstFirst = (runs) => [...runs].sort((a, b) => b.failed - a.failed || b.incomplete - a.incomplete || (b.ate_m ?? 0) - (a.ate_m ?? 0));

const show = (data, runs) => {
  const dialog = document.getElementById("run");
  const title = runs.length === 1 ? named(runs[0]) : `${runs[0].system} in ${runs[0].setting}: ${runs.length} runs`;
  dialog.querySelector("div").replaceChildren(make("h3", {}, title), ...ofRuns(data, worstFirst(runs)));
  dialog.showModal();
};

// --- the table of settings and systems ---

const median = (values) => {
  const sorted = values.filter((value) => value !== null).sort((a, b) => a - b);
  if (!sorted.length) return null;
  const middle = sorted.length >> 1;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
};

const compare = (data, settings, systems) => {
  const place = document.getElementById("compared");
  place.hidden = settings.length < 2;
  if (place.hidden) return;
  const head = make("tr", {}, make("th", {}, "system"), ...settings.map((name) => make("th", {}, name)));
  const rows = systems.map((system) => make("tr", {}, make("th", { scope: "row" }, system), ...settings.map((setting) => {
    const runs = data.runs.filter((run) => run.system === system && run.setting === setting);
    const ended = runs.filter((run) => !run.failed && !run.incomplete);
    const rest = runs.length - ended.length;
    const ate = median(ended.map((run) => run.ate_m));
    const text = runs.length ? `${ate === null ? "no ATE" : `median ATE ${metres(+ate.toPrecision(3))}`}, ${runs.length} ${runs.length === 1 ? "run" : "runs"}${rest ? `, ${rest} failed or incomplete` : ""}` : "no run";
    return make("td", {}, text);
  })));
  const choice = make("select", { "aria-label": "whose runs are drawn" });
  const shared = data.runs.filter((run) => run.setting === settings[0] && settings.every((setting) => data.runs.some(
    (other) => other.setting === setting && other.system === run.system && other.scene === run.scene)));
  const keys = [...new Map(shared.map((run) => [`${run.system} in ${run.scene}`, run])).entries()];
  choice.append(...keys.map(([text], index) => make("option", { value: index }, text)));
  const below = make("div", {});
  const draw = () => {
    const [, first] = keys[choice.value];
    const runs = settings.map((setting) => data.runs.find((run) => run.setting === setting && run.system === first.system && run.scene === first.scene));
    // In one picture: each setting has its own sequence, along one true path unless it moves the camera.
    const figures = [pathsOf(data, runs), errorsOf(runs)].filter(Boolean);
    below.replaceChildren(legend(runs), make("div", { class: "beside" }, ...figures));
  };
  choice.addEventListener("change", draw);
  place.replaceChildren(make("h3", {}, "Compared"), make("div", { class: "scroll" }, make("table", {}, make("thead", {}, head), make("tbody", {}, ...rows))),
    ...(keys.length ? [make("p", {}, choice), below] : [make("p", { class: "soft" }, "No system ran in both on one scene.")]));
  if (keys.length) draw();
};

const openGrid = (data) => {
  const grid = document.getElementById("grid");
  if (!grid) return;
  const systems = [...new Set([...grid.querySelectorAll("button")].map((button) => button.dataset.system))];
  for (const button of grid.querySelectorAll("button")) {
    const { setting, system } = button.dataset;
    const runs = data.runs.filter((run) => run.setting === setting && run.system === system);
    button.disabled = !runs.length;
    const [red, green, blue] = getComputedStyle(button.parentElement).backgroundColor.match(/\d+/g).map(Number);
    if (0.299 * red + 0.587 * green + 0.114 * blue < 128) button.classList.add("dark");
    button.addEventListener("click", () => show(data, runs));
  }
  grid.addEventListener("change", () => {
    compare(data, [...grid.querySelectorAll("input:checked")].map((box) => box.value), systems);
  });
};

const begin = async () => {
  const data = await unpack();
  showFigures(data.figures);
  openTables(data);
  openGrid(data);
  document.documentElement.dataset.ready = "";
};

begin();
