// Area of the slices over height: the profile of the pile, as it stands. Height goes up.

import React from "React";
import { _, fill } from "./gettext";
import { fixed, number } from "./units";

const WIDTH = 300;
const HEIGHT = 170;
const LEFT = 38;
const RIGHT = 8;
const TOP = 8;
const BOTTOM = 26;

export default class Chart extends React.Component {
  state = { at: null };

  move = (event) => {
    const box = event.currentTarget.getBoundingClientRect();
    const y = (event.clientY - box.top) / box.height * HEIGHT;
    const z = this.low + (HEIGHT - BOTTOM - y) / (HEIGHT - BOTTOM - TOP) * (this.high - this.low);
    const at = this.slices.findIndex((slice) => Math.abs(slice.z - z) <= slice.height / 2);
    this.setState({ at: at < 0 ? null : at });
  };

  keyed = (event) => {
    const step = { ArrowUp: 1, ArrowDown: -1, Home: -Infinity, End: Infinity }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    const last = this.slices.length - 1;
    const from = this.state.at === null ? (step > 0 ? -1 : last + 1) : this.state.at;
    this.setState({ at: Math.min(Math.max(from + step, 0), last) });
  };

  measured() {
    const { result } = this.props;
    return result.slices.map((slice) => ({
      z: slice.z_m,
      height: slice.height_m,
      area: Math.abs(slice.area_m2),
      volume: slice.volume_m3,
      points: slice.points,
    })).filter(({ z, height, area }) => [z, height, area].every(Number.isFinite)).sort((a, b) => a.z - b.z);
  }

  render() {
    const { units, terrain } = this.props;
    this.slices = this.measured();
    if (!this.slices.length) return null;
    this.low = Math.min(...this.slices.map(({ z, height }) => z - height / 2));
    this.high = Math.max(...this.slices.map(({ z, height }) => z + height / 2));
    const widest = Math.max(...this.slices.map(({ area }) => area)) || 1;
    const x = (area) => LEFT + area / widest * (WIDTH - LEFT - RIGHT);
    const y = (z) => HEIGHT - BOTTOM - (z - this.low) / (this.high - this.low || 1) * (HEIGHT - BOTTOM - TOP);
    const { at } = this.state;
    const across = ticks(0, widest * units.perSquareMetre, 4);
    const up = ticks(this.low * units.perMetre, this.high * units.perMetre, 5);
    return (
      <figure className="vc-chart">
        <figcaption>{terrain ? _("Area of the slices over height above the base") : _("Area of the slices over elevation")}</figcaption>
        <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" tabIndex={0} aria-label={this.inWords(widest)}
          onMouseMove={this.move} onMouseLeave={() => this.setState({ at: null })} onKeyDown={this.keyed}
          onBlur={() => this.setState({ at: null })}>
          {across.map((tick) => (
            <g key={`x${tick}`}>
              <line className="vc-grid" x1={x(tick / units.perSquareMetre)} x2={x(tick / units.perSquareMetre)} y1={TOP} y2={HEIGHT - BOTTOM} />
              <text x={x(tick / units.perSquareMetre)} y={HEIGHT - BOTTOM + 12} textAnchor="middle">{tickText(tick, across)}</text>
            </g>
          ))}
          {up.map((tick) => (
            <g key={`y${tick}`}>
              <line className="vc-grid" x1={LEFT} x2={WIDTH - RIGHT} y1={y(tick / units.perMetre)} y2={y(tick / units.perMetre)} />
              <text x={LEFT - 4} y={y(tick / units.perMetre) + 3} textAnchor="end">{tickText(tick, up)}</text>
            </g>
          ))}
          {this.slices.map((slice, index) => (
            <rect key={slice.z} x={LEFT} width={Math.max(x(slice.area) - LEFT, 0.5)} y={y(slice.z + slice.height / 2)}
              height={Math.max(y(slice.z - slice.height / 2) - y(slice.z + slice.height / 2) - 0.6, 0.6)}
              className={`${terrain && slice.z < 0 ? "vc-bar-fill" : "vc-bar-cut"}${index === at ? " vc-on" : ""}`} />
          ))}
          {terrain && this.low < 0 && this.high > 0
            ? <line className="vc-zero" x1={LEFT} x2={WIDTH - RIGHT} y1={y(0)} y2={y(0)} /> : null}
          <text x={WIDTH - RIGHT} y={HEIGHT - 2} textAnchor="end">{fill(_("area, %(unit)s"), { unit: units.areaUnit })}</text>
          <text x={2} y={HEIGHT - 2}>{fill(_("height, %(unit)s"), { unit: units.lengthUnit })}</text>
        </svg>
        <div className="vc-quiet vc-read" role="status">{at === null || !this.slices[at] ? "\u00a0" : this.words(this.slices[at])}</div>
      </figure>
    );
  }

  words({ z, area, volume, points }) {
    const { units } = this.props;
    const seen = Number.isFinite(points) ? ` · ${fill(_("%(count)s points"), { count: number(points, null, 1) })}` : "";
    return `${_("at")} ${units.length(z)}: ${units.area(area)} · ${units.volume(volume)}${seen}`;
  }

  inWords(widest) {
    const { units } = this.props;
    return fill(_("%(count)s slices from %(low)s to %(high)s, the largest of %(area)s. Arrow keys go through them."), {
      count: this.slices.length,
      low: units.length(this.low),
      high: units.length(this.high),
      area: units.area(widest),
    });
  }
}

/** A tick's number, with the decimals that tell it from the next one's. */
export function tickText(tick, all) {
  const step = all.length > 1 ? all[1] - all[0] : Math.abs(tick) || 1;
  return fixed(tick, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
}

/** Round numbers between two others, about as many as asked for. */
export function ticks(low, high, about) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / about;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((size) => size >= rough);
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i += 1) found.push(i * step);
  return found;
}
