// Numbers as people read them, in the units that WebODM's selector shows. WebODM keeps the choice
// in localStorage and tells of a change with an event; a built bundle cannot import its module.

const FOOT = 0.3048;
const SURVEY_FOOT = 1200 / 3937;
const SHORT_TON_T = 0.90718474;
const LB_FT3_PER_T_M3 = 1000 / 0.45359237 * FOOT ** 3;

const THIN_SPACE = "\u202f";
const MINUS = "\u2212";
export const NOTHING = "–";
const INTERVAL95 = 1.96;

class UnitSystem {
  constructor(key, foot, suffix = "") {
    const us = foot !== null;
    this.key = key;
    this.report = us ? "us" : "metric";
    this.lengthUnit = us ? `ft${suffix}` : "m";
    this.areaUnit = us ? `ft²${suffix}` : "m²";
    this.volumeUnit = us ? `yd³${suffix}` : "m³";
    this.massUnit = us ? "short tons" : "t";
    this.densityUnit = us ? "lb/ft³" : "t/m³";
    this.perMetre = us ? 1 / foot : 1;
    this.perSquareMetre = this.perMetre ** 2;
    this.perCubicMetre = us ? this.perMetre ** 3 / 27 : 1;
    this.perTonne = us ? 1 / SHORT_TON_T : 1;
    this.densityPerSI = us ? LB_FT3_PER_T_M3 : 1;
  }

  volumeNumber(m3, std) {
    return number(times(m3, this.perCubicMetre), times(std, this.perCubicMetre), 5);
  }

  volume(m3, std) {
    return withUnit(this.volumeNumber(m3, std), this.volumeUnit);
  }

  /** The half width of the 95 % interval, with its sign in front: "± 1.2". */
  margin(std, digitsOf = std) {
    return plusMinus(times(std, this.perCubicMetre), times(digitsOf, this.perCubicMetre));
  }

  mass(tonnes, std) {
    const value = number(times(tonnes, this.perTonne), times(std, this.perTonne), 4);
    return withUnit(std ? `${value} ${plusMinus(std * this.perTonne)}` : value, this.massUnit);
  }

  area(m2, digits = 4) {
    return withUnit(number(times(m2, this.perSquareMetre), null, digits), this.areaUnit);
  }

  lengthNumber(m) {
    if (!usable(m)) return NOTHING;
    const value = m * this.perMetre;
    return Math.abs(value) >= 1 || value === 0 ? fixed(value, 2) : number(value, null, 3);
  }

  length(m) {
    return withUnit(this.lengthNumber(m), this.lengthUnit);
  }

  /** A sentence of the server's, which is metric, with its volumes, areas and lengths in these units. */
  sentence(words) {
    const of = { m: [this.lengthUnit, this.perMetre], m2: [this.areaUnit, this.perSquareMetre],
      m3: [this.volumeUnit, this.perCubicMetre] };
    return String(words).replace(QUANTITY, (all, before, value, unit) => {
      const [name, factor] = of[unit];
      return `${before}${factor === 1 ? value : scaled(value, factor)} ${name}`;
    });
  }
}

// A number with its unit: no part of a name, of an option or of another unit (m/s).
const QUANTITY = /(^|[^\w.])(\d+(?:,\d{3})*(?:\.\d+)?(?:[eE][-+]?\d+)?) (m3|m2|m)(?![\w/])/g;

/** A written number times a factor, with as many significant digits, two at the least. */
function scaled(written, factor) {
  const bare = written.replace(/,/g, "");
  const digits = bare.toLowerCase().split("e")[0].replace(".", "").replace(/^0+/, "").length;
  return String(Number((Number(bare) * factor).toPrecision(Math.max(digits, 2))));
}

const SYSTEMS = {
  metric: new UnitSystem("metric", null),
  imperial: new UnitSystem("imperial", FOOT),
  imperialUS: new UnitSystem("imperialUS", SURVEY_FOOT, " (US)"),
};

export function unitSystem() {
  let key = null;
  try {
    key = window.localStorage.getItem("unit_system");
  } catch (e) {
    // Storage can be forbidden; WebODM itself then shows metres.
  }
  return SYSTEMS[key] || SYSTEMS.metric;
}

/** Call back with the new system whenever it changes; returns how to stop. */
export function onUnitsChanged(callback) {
  const told = (event) => callback(SYSTEMS[event.detail] || unitSystem());
  document.addEventListener("onUnitSystemChanged", told);
  return () => document.removeEventListener("onUnitSystemChanged", told);
}

/** Two significant digits of the standard deviation decide; without one, `digits` of the value. */
export function number(value, std = null, digits = 4) {
  if (!usable(value)) return NOTHING;
  if (usable(std) && std > 0) return fixed(value, Math.min(1 - powerOfTen(std, 2), 9));
  if (value === 0) return "0";
  return fixed(value, Math.min(Math.max(digits - 1 - powerOfTen(value, digits), 0), 9));
}

/** A number with that many decimals; negative ones round to tens, hundreds, ... */
export function fixed(value, decimals) {
  const step = 10 ** Math.max(-decimals, 0);
  const text = (Math.round(Math.abs(value) / step) * step).toFixed(0);
  const bare = decimals > 0 ? Math.abs(value).toFixed(decimals) : text;
  const [whole, part] = bare.split(".");
  const grouped = whole.replace(/\B(?=(\d{3})+(?!\d))/g, THIN_SPACE) + (part ? `.${part}` : "");
  return value < 0 && /[1-9]/.test(bare) ? MINUS + grouped : grouped;
}

export function percent(share) {
  if (!usable(share)) return NOTHING;
  return `${fixed(share < 1 ? Math.min(share * 100, 99.9) : 100, share < 0.995 ? 0 : 1)} %`.replace(".0", "");
}

/** Read a number that a person typed: a decimal comma counts as a point. null if it is none. */
export function typed(text) {
  if (isUnclear(text)) return null;
  const bare = String(text).trim().replace(",", ".").replace(MINUS, "-");
  if (!/^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(bare)) return null;
  return Number(bare);
}

/** Whether a comma may be either a point or what parts thousands: 1,234. */
export function isUnclear(text) {
  return /^[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?$/.test(String(text).trim().replace(MINUS, "-"));
}

/** Convert a typed text by a factor, in the digits that a person would type. */
export function retyped(text, factor) {
  const value = typed(text);
  return value === null || factor === 1 ? text : String(Number((value * factor).toPrecision(7)));
}

function plusMinus(std, digitsOf = std) {
  return usable(std) ? `± ${number(std * INTERVAL95, digitsOf)}` : "";
}

function usable(value) {
  return typeof value === "number" && Number.isFinite(value);
}

function times(value, factor) {
  return usable(value) ? value * factor : null;
}

function powerOfTen(value, digits) {
  return Number(Math.abs(value).toExponential(digits - 1).split("e")[1]);
}

function withUnit(text, unit) {
  return text === NOTHING ? text : `${text}\u00a0${unit}`;
}
