// What the form holds, and what the API is told of it.

import { readAreas } from "./geometry";
import { _ } from "./gettext";
import { isUnclear, retyped, typed } from "./units";

export const EMPTY_FORM = {
  area: "draw", // draw | file | auto | crop | whole
  file: null, // {name, geojson, count}
  base: "", // the server's default
  elevation: "",
  toe: false, // outlines are moved to the toe
  layer: "upper", // upper | lower | mean, where two surfaces lie over each other
  density: "",
  densitySigma: "",
  shape: "terrain",
  method: "section",
  slicing: "auto", // auto | count | height
  slices: "20",
  sliceHeight: "",
  hollow: false,
  centerCaps: false,
  maxGap: "",
  floor: "auto", // auto | none | plane | elevation
  floorElevation: "",
  grid: false,
  control: "none", // none | file | bars
  controlFile: null, // {name, text}
  scaleMode: "auto",
  areaFrame: "cloud",
  crs: "",
  verticalUnit: "", // as the cloud says
  sourceUnit: "",
};

/** What a base may be; the server's default comes first. */
export function basesOf(info) {
  return [...info.bases, "elevation", "compare"];
}

/** The form with a base that there is. */
export function withBase(form, info) {
  const bases = basesOf(info);
  return bases.includes(form.base) ? form : { ...form, base: bases[0] };
}

const CRS = /^\s*(EPSG:\d{1,6}(\+\d{1,6})?\s*$|\+proj=|[A-Z_]{5,20}\s*\[)/i;

const LENGTHS = ["elevation", "sliceHeight", "maxGap", "floorElevation"];
const DENSITIES = ["density", "densitySigma"];

/** The same form with its lengths and densities written in other units. */
export function inUnits(form, from, to) {
  const changed = { ...form };
  LENGTHS.forEach((key) => (changed[key] = retyped(form[key], to.perMetre / from.perMetre)));
  DENSITIES.forEach((key) => (changed[key] = retyped(form[key], to.densityPerSI / from.densityPerSI)));
  return changed;
}

const UNCLEAR = () => _("Write the number without that comma: it could be thousands or a decimal.");

/** What must be mended before measuring, by field: {field: words}. */
export function wrongFields(form, bars) {
  const wrong = {};
  const need = (key, holds, words) => {
    const value = typed(form[key]);
    if (value === null || !holds(value)) wrong[key] = isUnclear(form[key]) ? UNCLEAR() : words;
  };
  const positive = (value) => value > 0;
  const terrain = form.shape === "terrain";
  if (terrain && form.base === "elevation") need("elevation", Number.isFinite, _("Give an elevation."));
  if (form.density) need("density", positive, _("Give a number above 0, or nothing."));
  if (form.density && form.densitySigma) need("densitySigma", (v) => v >= 0, _("Give a number from 0, or nothing."));
  if (form.slicing === "count") {
    need("slices", (v) => v >= 1 && v === Math.round(v), _("Give a whole number from 1."));
  }
  if (form.slicing === "height") need("sliceHeight", positive, _("Give a height above 0."));
  if (!terrain && form.method === "section") {
    if (form.maxGap) need("maxGap", positive, _("Give a length above 0, or nothing."));
    if (form.floor === "elevation") need("floorElevation", Number.isFinite, _("Give an elevation."));
  }
  if (form.crs.trim() && !CRS.test(form.crs)) wrong.crs = _("Give EPSG: and a number, WKT, or a PROJ text (+proj=…).");
  if (form.control === "file" && !form.controlFile) wrong.control = _("Choose a control file.");
  if (form.control === "bars") {
    if (!bars.length) wrong.control = _("Add a scale bar, or choose None.");
    else if (bars.some((bar) => !(typed(bar.length) > 0))) wrong.control = _("Give each bar its measured length.");
    if (bars.some(({ length, accuracy }) => isUnclear(length) || isUnclear(accuracy))) wrong.control = UNCLEAR();
    else if (bars.some((bar) => !(typed(bar.accuracy) > 0))) {
      wrong.control = _("An accuracy is a length above 0.");
    }
  }
  return wrong;
}

/** The options of the library that the form asks for; only what differs from their defaults. */
export function toOptions(form, units) {
  const metres = (text) => typed(text) / units.perMetre;
  const options = { shape: form.shape };
  if (form.slicing === "count") options.slices = typed(form.slices);
  if (form.slicing === "height") options.slice_height = metres(form.sliceHeight);
  if (form.shape === "terrain") {
    options.base = form.base === "elevation" ? metres(form.elevation) : form.base;
    if (form.toe && (form.area === "draw" || form.area === "file")) options.toe = "auto";
    if (form.layer !== "upper") options.layer = form.layer;
  } else {
    options.method = form.method;
    if (form.method === "polar" && form.centerCaps) options.center_caps = true;
    if (form.method === "section") {
      if (form.hollow) options.hollow = true;
      if (form.maxGap) options.max_gap = metres(form.maxGap);
      if (form.floor === "elevation") options.floor = metres(form.floorElevation);
      else if (form.floor !== "auto") options.floor = form.floor;
    }
  }
  if (form.density) {
    options.density = typed(form.density) / units.densityPerSI;
    if (form.densitySigma) options.density_sigma = typed(form.densitySigma) / units.densityPerSI;
  }
  if (form.control === "none") {
    if (form.grid) options.grid = true;
  } else {
    if (form.scaleMode !== "auto") options.scale_mode = form.scaleMode;
    if (form.areaFrame !== "cloud") options.area_frame = form.areaFrame;
  }
  if (form.crs.trim()) options.crs = form.crs.trim();
  else if (form.sourceUnit) options.source_unit = form.sourceUnit;
  if (form.verticalUnit) options.vertical_unit = form.verticalUnit;
  return options;
}

/** A form with the area and the settings of a measurement, to change and measure anew. */
export function fromDocument({ name, area, options, measurement }, units, onMap) {
  const { base } = measurement.results.find((result) => !result.error) || {};
  const form = fromOptions({ base, ...options }, units);
  if (!area) return { ...form, area: "whole" };
  if (onMap) return { ...form, area: "draw" };
  return { ...form, area: "file", file: { name, ...readAreas(JSON.stringify(area)) } };
}

function fromOptions(options, units) {
  const length = (metres) => retyped(String(metres), units.perMetre);
  const has = (key) => options[key] !== undefined && options[key] !== null;
  const form = { ...EMPTY_FORM };
  if (options.shape === "object" || has("method")) form.shape = "object";
  if (has("method")) form.method = options.method;
  if (typeof options.base === "number") Object.assign(form, { base: "elevation", elevation: length(options.base) });
  else if (has("base")) form.base = options.base;
  form.toe = has("toe");
  if (has("layer")) form.layer = options.layer;
  if (typeof options.slices === "number") Object.assign(form, { slicing: "count", slices: String(options.slices) });
  if (has("slice_height")) Object.assign(form, { slicing: "height", sliceHeight: length(options.slice_height) });
  if (has("density")) form.density = retyped(String(options.density), units.densityPerSI);
  if (options.density_sigma) form.densitySigma = retyped(String(options.density_sigma), units.densityPerSI);
  if (typeof options.floor === "number") {
    Object.assign(form, { floor: "elevation", floorElevation: length(options.floor) });
  } else if (has("floor")) {
    form.floor = options.floor;
  }
  if (has("max_gap")) form.maxGap = length(options.max_gap);
  form.hollow = Boolean(options.hollow);
  form.centerCaps = Boolean(options.center_caps);
  form.grid = Boolean(options.grid);
  form.crs = String(options.crs || "");
  form.verticalUnit = String(options.vertical_unit || "");
  form.sourceUnit = String(options.source_unit || "");
  return form;
}

/** The control points as the API takes them; null without. */
export function toControl(form, bars, units) {
  if (form.control === "file") return { text: form.controlFile.text, name: form.controlFile.name };
  if (form.control === "none") return null;
  return {
    scale_bars: bars.map(({ from, to, length, accuracy }) => ({
      from,
      to,
      length_m: typed(length) / units.perMetre,
      accuracy_m: typed(accuracy) / units.perMetre,
    })),
  };
}
