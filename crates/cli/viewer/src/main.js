// The 3-D view of a report and what goes with it. The page around it is written by `hemicube report`.

import { array, row } from "./blocks.js";
import { GRADIENT, NOTHING, SELECTED, idColor, lightColors, quantile, scaleColor } from "./colors.js";
import { Model } from "./scene.js";

const started = performance.now();
const $ = (id) => document.getElementById(id);
const head = JSON.parse($("head").textContent);
const numbers = new Intl.NumberFormat("en");
/** Entries of a row in the table beside the model. */
const LISTED = 100;

/** Four significant figures, without an exponent where that is readable. */
function figures(value) {
  if (value === undefined || Number.isNaN(value)) return "none";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e-3 || size >= 1e6) return value.toExponential(3);
  if (Number.isInteger(value)) return numbers.format(value);
  return String(Number(value.toPrecision(4)));
}

function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

/** What the page has of each patch, by the name of the block. */
const columns = {};
for (const { name, type } of head.columns) columns[name] = await array(name, type);

let model;
let selected = -1;
let selectedRow = null;

// A patch of several objects is by its material.
const objectOf = (patch) => head.objects[columns.object[patch]] ?? head.materials[columns.material[patch]] ?? "";

// ---- colours -------------------------------------------------------------------------------------------------------

/** What a scale from `low` to `high` makes of a number; logarithmic where that is asked for. */
function scaled(values, logarithmic) {
  // A hundredth at either end may be far off the rest; it is shown in the colour of the end.
  let [low, high] = [quantile(values, 0), quantile(values, 1)];
  if (logarithmic) {
    const cut = !(low >= high * 1e-4);
    if (cut) low = high * 1e-4;
    const [from, to] = [Math.log(low), Math.log(high)];
    return { low, high, cut, of: (value) => (value > 0 ? (Math.log(value) - from) / (to - from || 1) : 0) };
  }
  return { low, high, of: (value) => (value - low) / (high - low || 1) };
}

/** Tells what the colours mean; `scale` is undefined where they are no scale. */
function legend(scale, what, logarithmic = false) {
  $("legend-bar").style.background = GRADIENT;
  $("legend").hidden = scale === undefined;
  // Values below the lowest decade have its colour.
  $("legend-low").textContent = `${scale?.cut ? "\u2264 " : ""}${figures(scale?.low)}`;
  $("legend-high").textContent = figures(scale?.high);
  $("legend-what").textContent = logarithmic ? `${what}; logarithmic scale` : what;
}

function paint() {
  const field = head.fields.find((other) => other.key === $("field").value);
  const logarithmic = $("log").checked;
  $("log").parentElement.hidden = !field.scale;
  // Light has shades of its own.
  $("shade").parentElement.hidden = field.light;
  model.set("shade", $("shade").checked && !field.light);
  let of;
  if (field.key === "row") {
    const factors = new Map((selectedRow?.entries ?? []).map((entry) => [entry.patch, entry.factor]));
    const found = [...factors.values()].filter((value) => value > 0);
    if (found.length === 0) {
      legend(undefined, selected < 0 ? "click a patch to see its row" : "this patch has no row with entries");
      of = () => NOTHING;
    } else {
      const scale = scaled(Float32Array.from(found), logarithmic);
      const all = columns.seen[selected];
      const entries = selectedRow.entries.length;
      const which = entries < all ? `its largest ${numbers.format(entries)} of ${numbers.format(all)} entries` : `all ${numbers.format(all)} entries`;
      legend(scale, `form factor from patch ${numbers.format(selected)} (red), ${which}`, logarithmic);
      of = (patch) => (factors.has(patch) ? scaleColor(scale.of(factors.get(patch))) : NOTHING);
    }
  } else if (field.light) {
    legend(undefined, field.note);
    of = lightColors(field.columns.map((name) => columns[name]));
  } else if (field.key === "object") {
    legend(undefined, field.note);
    of = (patch) => idColor(columns.object[patch]);
  } else {
    const values = columns[field.columns[0]];
    const scale = scaled(values, logarithmic);
    legend(scale, field.note, logarithmic);
    of = (patch) => (Number.isNaN(values[patch]) ? NOTHING : scaleColor(scale.of(values[patch])));
  }
  model.paint((patch) => (patch === selected ? SELECTED : of(patch)));
}

// ---- the patch that was clicked -------------------------------------------------------------------------------------

function describe(patch) {
  const list = $("patch-facts");
  list.replaceChildren();
  const add = (label, value) => list.append(element("dt", label), element("dd", value));
  add("object", objectOf(patch) || "no name");
  if (head.materials[columns.material[patch]]) add("material", head.materials[columns.material[patch]]);
  add("area", figures(columns.area[patch]));
  for (const field of head.fields) {
    if (field.columns.length === 0) continue;
    add(field.label.toLowerCase(), field.columns.map((name) => figures(columns[name][patch])).join(", "));
  }
}

function table(body, rows) {
  body.replaceChildren(...rows.map((cells) => {
    const line = element("tr");
    for (const cell of cells) {
      const made = element("td");
      made.append(cell);
      line.append(made);
    }
    return line;
  }));
}

function button(patch) {
  const made = element("button", numbers.format(patch), { type: "button", class: "patch", "aria-label": `select patch ${patch}` });
  made.dataset.patch = patch;
  return made;
}

/** Says why a number is refused, or that none is. */
function refuse(reason) {
  $("patch-error").hidden = !reason;
  $("patch-error").textContent = reason;
  $("patch-number").setAttribute("aria-invalid", String(reason !== ""));
}

/** Selects the patch of a typed number or of a button, and moves the view to it. */
async function visit(patch) {
  if (await select(patch) && patch >= 0) await model.goTo(patch);
}

/** Selects a patch, and shows its row; -1 selects none. False for a number that is no patch's: the selection stays. */
async function select(patch) {
  if (!Number.isInteger(patch) || patch < -1 || patch >= head.patches) {
    const what = Number.isNaN(patch) ? "That is no number" : `There is no patch ${numbers.format(patch)}`;
    refuse(`${what}: patches are 0 to ${numbers.format(head.patches - 1)}.`);
    return false;
  }
  refuse("");
  selected = patch;
  $("patch-number").value = patch < 0 ? "" : patch;
  $("patch").hidden = patch < 0;
  $("patch-none").hidden = patch >= 0;
  selectedRow = null;
  if (patch >= 0) {
    $("patch-name").textContent = `Patch ${numbers.format(patch)}`;
    describe(patch);
    const found = head.rows ? await row(patch, head.rows.per_block) : null;
    if (selected !== patch) return false;
    selectedRow = found;
    $("row").hidden = !found;
    $("row-none").hidden = !!found;
    $("row-none").textContent = head.rows ? "The row of this patch was not computed." : "This page was written without rows.";
    if (found) {
      const all = columns.seen[patch];
      const total = columns.row_sum[patch];
      const shown = found.entries.reduce((sum, entry) => sum + entry.factor, 0);
      const listed = found.entries.slice(0, LISTED);
      $("row-summary").textContent = all > found.entries.length
        ? `Of ${numbers.format(all)} entries, which sum to ${figures(total)}, these are the largest ${found.entries.length}; they sum to ${figures(shown)}.`
        : `All ${numbers.format(all)} entries are in colour; they sum to ${figures(total)}.`;
      if (listed.length < found.entries.length) $("row-summary").textContent += ` The largest ${LISTED} are listed.`;
      const largest = found.entries[0]?.factor || 1;
      table($("row-entries"), listed.map((entry) => {
        const bar = element("span", undefined, { class: "bar" });
        bar.style.width = `${(100 * entry.factor) / largest}%`;
        const factor = element("span", figures(entry.factor));
        const cell = element("span", undefined, { class: "barred" });
        cell.append(bar, factor);
        return [button(entry.patch), objectOf(entry.patch), cell];
      }));
      const named = found.objects.reduce((sum, object) => sum + object.factor, 0);
      const rows = found.objects.map(({ object, factor }) => [head.objects[object] || "no name", figures(factor)]);
      if (total - named > 1e-3 * total) rows.push(["all others", figures(total - named)]);
      table($("row-objects"), rows);
    }
  }
  paint();
  return true;
}

// ---- the page -------------------------------------------------------------------------------------------------------

function theme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  $("theme").textContent = dark ? "Light" : "Dark";
}
theme(matchMedia("(prefers-color-scheme: dark)").matches);
$("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme !== "dark"));

function fail(error) {
  $("view-error").hidden = false;
  $("view-error").textContent = `The 3-D view cannot be shown: ${error.message ?? error}. Everything else on this page needs no WebGL.`;
  document.documentElement.dataset.ready = "failed";
}

try {
  const canvas = $("view");
  const patchOf = head.elements ? await array("patch-of", "u32") : null;
  model = new Model(canvas, await array("corners", "u16"), await array("triangles", "u32"), head, patchOf);
  for (const { key, label } of head.fields) $("field").append(element("option", label, { value: key }));
  const resize = () => model.resize(canvas.clientWidth, canvas.clientHeight, Math.min(devicePixelRatio, 2));
  resize();
  model.fit();
  new ResizeObserver(resize).observe(canvas);

  const applied = () => {
    const field = head.fields.find((other) => other.key === $("field").value);
    $("log").checked = !!field.logarithmic;
    paint();
  };
  $("field").addEventListener("change", applied);
  $("log").addEventListener("change", paint);
  for (const what of ["shade", "edges", "backs"]) $(what).addEventListener("change", () => model.set(what, $(what).checked));
  $("fit").addEventListener("click", () => model.fit());
  $("top").addEventListener("click", () => model.top());
  $("patch-number").addEventListener("change", () => {
    // What is typed and no number is empty, too.
    const field = $("patch-number");
    visit(field.value === "" && !field.validity.badInput ? -1 : field.valueAsNumber).catch(fail);
  });
  document.addEventListener("click", (event) => {
    const patch = event.target.closest?.("button.patch")?.dataset.patch;
    if (patch !== undefined) visit(Number(patch)).catch(fail);
  });
  // A click is a press that did not move.
  let pressed = null;
  canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
    const box = canvas.getBoundingClientRect();
    model.pick(event.clientX - box.left, event.clientY - box.top).then(select, fail);
  });
  applied();
  model.drawNow();
  $("loading").hidden = true;
  /** For scripts in the browser's console: docs/report.md. */
  window.hemicube = {
    head, columns, select, visit, row: (patch) => row(patch, head.rows.per_block),
    pick: (x, y) => model.pick(x, y), placeOf: (patch) => model.placeOf(patch),
    frames: () => model.frames, drawNow: () => model.drawNow(), model,
    milliseconds: performance.now() - started, sinceNavigation: performance.now(),
  };
  document.documentElement.dataset.ready = "yes";
} catch (error) {
  fail(error);
}
