// The lower half of a result: what the error is made of, other bases, how it was measured.

import React from "React";
import { _, fill } from "./gettext";
import { number } from "./units";
import { baseName, budgetWords, coordinateRows, seconds, shapeWords } from "./words";
import { Fold } from "./ui";

export function Budget({ result, units }) {
  const items = (result.budget || []).filter(({ std_m3: std }) => std !== null);
  const largest = Math.max(...items.map(({ std_m3: std }) => std), 1e-12);
  return (
    <table className="vc-table">
      <tbody>
        {items.map(({ source, std_m3: std }) => (
          <tr key={source}>
            <th scope="row">
              {budgetWords(source)}
              <div className="vc-meter" aria-hidden="true"><div style={{ width: `${(std / largest) * 100}%` }} /></div>
            </th>
            <td className="vc-right">{units.margin(std, result.std_m3)}</td>
          </tr>
        ))}
        <tr className="vc-total">
          <th scope="row">{_("All together (root of the sum of squares)")}</th>
          <td className="vc-right">{units.margin(result.std_m3)}</td>
        </tr>
      </tbody>
      <caption>{fill(_("Half widths of 95 % intervals, in %(unit)s"), { unit: units.volumeUnit })}</caption>
    </table>
  );
}

export function Bases({ result, units }) {
  return (
    <div className="vc-scroll">
      <table className="vc-table">
        <thead>
          <tr>
            <th scope="col">{_("Base")}</th>
            <th scope="col" className="vc-right">{_("Net")}</th>
            <th scope="col" className="vc-right">{_("Cut")}</th>
            <th scope="col" className="vc-right">{_("Fill")}</th>
            <th scope="col" className="vc-right">±</th>
          </tr>
        </thead>
        <tbody>
          {result.bases.map((row) => (
            <tr key={row.base} className={row.base === result.base ? "vc-on" : ""}>
              <th scope="row">{baseName(row.base, units)}</th>
              <td className="vc-right">{units.volumeNumber(row.volume_m3, row.std_m3)}</td>
              <td className="vc-right">{units.volumeNumber(row.cut_m3, row.std_m3)}</td>
              <td className="vc-right">{units.volumeNumber(row.fill_m3, row.std_m3)}</td>
              <td className="vc-right">{units.margin(row.std_m3).replace("± ", "")}</td>
            </tr>
          ))}
        </tbody>
        <caption>{fill(_("In %(unit)s; the row in bold is the one above."), { unit: units.volumeUnit })}</caption>
      </table>
    </div>
  );
}

// The colours of the relief's picture, from as far below the base as above it.
const COLOURS = [
  [-1, "#123a63"], [-0.72, "#2468a3"], [-0.4, "#6fa8d2"], [-0.14, "#cfe1ec"], [0, "#f8f6f1"],
  [0.14, "#f5dbc6"], [0.4, "#e29a6c"], [0.72, "#bb5130"], [1, "#6e1d12"],
];

/** What the colours on the map mean. */
export function Legend({ relief, units, terrain }) {
  const { min_m: low, max_m: high } = relief;
  const limit = relief.limit_m || Math.max(Math.abs(low), Math.abs(high));
  if (![low, high, limit].every(Number.isFinite) || !(high > low)) return null;
  const at = (height) => ((height - low) / (high - low)) * 100;
  const stops = COLOURS.map(([share, colour]) => `${colour} ${at(share * limit).toFixed(1)}%`);
  return (
    <div className="vc-legend">
      <span className="vc-quiet">{terrain ? _("Height above the base, on the map") : _("Height, on the map")}</span>
      <div className="vc-ramp" aria-hidden="true" style={{ background: `linear-gradient(90deg, ${stops.join(", ")})` }} />
      <div className="vc-ends"><span>{units.length(low)}</span><span>{units.length(high)}</span></div>
    </div>
  );
}

/** How it was measured: for those who have to answer for it. */
export function Details({ doc, units }) {
  const { measurement, options } = doc;
  const { provenance = {}, scale } = measurement;
  const rows = [
    [_("Shape"), shapeWords(measurement.shape)],
    [_("Method"), `${measurement.method}, ${fill(_("version %(number)s"), { number: measurement.method_revision })}`],
    [_("Point cloud"), doc.source === "ept" ? _("tiles (EPT)") : String(doc.source || "").toUpperCase()],
    [_("Coordinates"), shortCrs(measurement.crs)],
    [_("Grid scale factor"), Number.isFinite(measurement.grid_scale_factor) ? measurement.grid_scale_factor.toFixed(6) : null],
    [_("Scale by control"), scale && Number.isFinite(scale.factor)
      ? `× ${scale.factor.toFixed(5)}${Number.isFinite(scale.std) ? ` ± ${number(1.96 * scale.std, scale.std)}` : ""}`
      : null],
    ...coordinateRows(provenance.coordinates),
    ...optionRows(options || {}, units),
    [_("Computed in"), seconds(provenance.seconds)],
    [_("Version"), provenance.version],
  ].filter(([, value]) => value !== null && value !== undefined && value !== "");
  return (
    <Fold title={_("How it was measured")}>
      <dl className="vc-list">
        {rows.map(([word, value]) => <div key={word}><dt>{word}</dt><dd>{String(value)}</dd></div>)}
      </dl>
      {measurement.results.map(({ name, checks }) => (checks || []).map((check) => (
        <p key={name + check.method} className="vc-quiet">
          {fill(_("Check, %(name)s: %(method)s give %(volume)s"),
            { name, method: check.method, volume: units.volume(check.volume_m3) })}
        </p>
      )))}
    </Fold>
  );
}

function shortCrs(crs) {
  const text = String(crs || "");
  const named = text.match(/^\s*\w+\s*\[\s*"([^"]*)"/);
  return named ? named[1] : text.slice(0, 60);
}

function optionRows(options, units) {
  return [
    [_("Slices"), options.slices && options.slices !== "auto" ? options.slices : null],
    [_("Slice height"), options.slice_height ? units.length(options.slice_height) : null],
    [_("Density"), options.density
      ? `${number(options.density * units.densityPerSI)} ${units.densityUnit}` : null],
    [_("Hollow"), options.hollow ? _("yes") : null],
    [_("Grid, not ground"), options.grid ? _("yes") : null],
  ];
}

