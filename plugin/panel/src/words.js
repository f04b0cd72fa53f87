// What the library's short names mean, for people.

import { _, fill } from "./gettext";

// Which of them there are, and which is the default, the server says.
const BASES = {
  kriged: [() => _("Predicted ground"), () => _("The ground under it, predicted from the ground around it (kriging).")],
  triangulate: [() => _("Ground along the outline"), () => _("Stretched between the points of the outline; right for most piles and pits.")],
  plane: [() => _("Best plane"), () => _("A tilted plane through the outline; right for piles on a flat yard.")],
  average: [() => _("Level, average"), () => _("A level at the outline's mean elevation.")],
  lowest: [() => _("Level, lowest"), () => _("A level at the outline's lowest point.")],
  highest: [() => _("Level, highest"), () => _("A level at the outline's highest point; the room left in a pit.")],
  elevation: [() => _("Level, at an elevation"), () => _("A level that you give, such as a design height.")],
  compare: [() => _("Compare all of them"), () => _("Measures on the first base of this list, and lists what all others give.")],
};

export function baseHint(base) {
  return Object.hasOwnProperty.call(BASES, base) ? BASES[base][1]() : null;
}

export function baseName(base, units) {
  if (Object.hasOwnProperty.call(BASES, base)) return BASES[base][0]();
  const level = Number(base);
  return base !== null && base !== "" && Number.isFinite(level)
    ? `${_("Level at")} ${units.length(level)}`
    : String(base);
}

/** The names of the bases of several areas, each once; null is one that was not measured. */
function baseNames(bases, units) {
  const each = [].concat(bases).map((base) => (base === null ? _("one area not measured") : baseName(base, units)));
  return [...new Set(each)].join("; ");
}

/** The sentences of warnings; before quantify-client/2 a warning was nothing else. */
export function warningWords(part) {
  return (part.warnings || []).map((warning) => (typeof warning === "string" ? warning : String(warning.text)));
}

export const UNITS = [
  ["m", () => _("Metres")],
  ["cm", () => _("Centimetres")],
  ["mm", () => _("Millimetres")],
  ["ft", () => _("Feet (international)")],
  ["us-ft", () => _("Feet (US survey)")],
];

const CRS_PARTS = {
  CRS: () => _("Coordinate system"),
  datum: () => _("Datum"),
  projection: () => _("Projection"),
  "horizontal unit": () => _("Unit of lengths"),
  heights: () => _("Heights"),
  "vertical unit": () => _("Unit of heights"),
};

/** What said each part of the cloud's coordinates, and what said otherwise: [word, words]. */
export function coordinateRows(coordinates) {
  return (coordinates || []).map(({ part, value, source, contradicted_by: others }) => [
    CRS_PARTS[part] ? CRS_PARTS[part]() : part,
    `${value} (${[source, ...others.map((other) => fill(_("not %(value)s, as %(source)s says"), other))].join("; ")})`,
  ]);
}

const BUDGET = {
  survey: () => _("Survey: noise of the points"),
  base: () => _("Base: what lies underneath"),
  scale: () => _("Scale: size of the whole cloud"),
  coverage: () => _("Coverage: gaps between points"),
  slicing: () => _("Slicing: thickness of the slices"),
  outline: () => _("Outline: where the edge runs"),
  sampling: () => _("Sampling: distance of the points"),
};

export function budgetWords(source) {
  return BUDGET[source] ? BUDGET[source]() : String(source);
}

export function shapeWords(shape) {
  return shape === "object" ? _("Closed body") : _("Terrain against a base");
}

/** What a volume is of: another base gives another volume, with no time in between. */
export function quantityWords({ shape, base }, units) {
  return shape === "terrain" && base !== null ? baseName(base, units) : shapeWords(shape);
}

export function revisionWords(revision) {
  return fill(_("by version %(number)s of the method"), { number: revision });
}

const SCALES = {
  cloud: () => _("not scaled by control"),
  control: () => _("scaled by control"),
  unknown: () => _("in an unknown unit"),
};

const APART = {
  shape: (quantity, units) => fill(_("of another kind (%(what)s)"), { what: quantityWords(quantity, units) }),
  method: ({ method }) => fill(_("by another method (%(what)s)"), { what: method }),
  method_revision: ({ method_revision: revision }) => revisionWords(revision),
  base: ({ base }, units) => fill(_("on another base (%(what)s)"), { what: baseNames(base, units) }),
  scale: ({ scale }) => (SCALES[scale] ? SCALES[scale]() : String(scale)),
  settings: ({ settings }) => fill(_("with other settings (%(what)s)"), {
    what: Object.keys(settings).map((name) => name.replace(/_/g, " ")).join(", ") || _("none"),
  }),
};

/** Why a volume is not compared with another, from what differs (see comparable.js). */
export function apartWords(quantity, names, units) {
  return names.map((name) => (APART[name] ? APART[name](quantity, units) : name)).join(", ");
}

/** A date as the reader's browser writes it; what is none stays as it is. */
export function when(text, withTime = true) {
  const date = new Date(text);
  if (Number.isNaN(date.getTime())) return String(text || "");
  return withTime
    ? date.toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" })
    : date.toLocaleDateString(undefined, { dateStyle: "medium" });
}

export function seconds(value) {
  if (!Number.isFinite(value)) return "";
  const whole = Math.round(value);
  if (whole < 60) return `${whole} s`;
  return `${Math.floor(whole / 60)} min${whole % 60 ? ` ${whole % 60} s` : ""}`;
}

/** A length of time in its largest sensible unit: "40 s", "3 min 20 s", "5 h", "7 d". */
export function span(value) {
  if (!(value >= 7200)) return seconds(value);
  const hours = Math.round(value / 3600);
  return hours < 48 ? `${hours} h` : `${Math.round(hours / 24)} d`;
}

const STAGES = {
  starting: () => _("Starting"),
  "reading points": () => _("Reading points"),
  "finding the body": () => _("Finding the body"),
  "measuring areas": () => _("Measuring areas"),
  slicing: () => _("Slicing"),
  drawing: () => _("Drawing the layers"),
};

/** How a measurement of one's own stands. */
export function stateWords({ state, stage, place }) {
  if (state === "running") return STAGES[stage] ? STAGES[stage]() : String(stage || _("Running"));
  if (state === "queued" && place > 0) return fill(_("Waiting for a worker, %(count)s before it"), { count: place });
  const known = {
    sending: _("Sending …"),
    queued: _("Waiting for a worker"),
    done: _("Finished, not saved yet"),
    failed: _("Failed"),
    cancelled: _("Cancelled"),
    lost: _("Lost"),
  };
  return known[state] || String(state);
}

/** Why it came to nothing, for those where the server says no more. */
export function endWords({ state, error }) {
  if (error) return error;
  if (state === "lost") return _("The server lost sight of this measurement. Start it again.");
  if (state === "failed") return _("The measurement failed. The server's log says why.");
  return null;
}
