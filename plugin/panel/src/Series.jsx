// The same area in all tasks of the project: how its volume went over time.

import React from "React";
import { READING } from "./api";
import { tickText, ticks } from "./Chart";
import { _, fill } from "./gettext";
import { Notice, Select, Spinner } from "./ui";
import { compared } from "./comparable";
import { apartWords, quantityWords, when } from "./words";

const WIDTH = 300;
const HEIGHT = 150;
const LEFT = 44;
const RIGHT = 12;
const TOP = 10;
const BOTTOM = 20;

export default class Series extends React.Component {
  state = { groups: null, unread: 0, leftOut: 0, chosen: null, error: null };

  componentDidMount() {
    this.alive = true;
    this.load(READING.times);
  }

  componentWillUnmount() {
    this.alive = false;
    clearTimeout(this.reading);
  }

  load(times) {
    this.props.api.series().then(
      (found) => this.alive && this.told(found, times),
      (error) => this.alive && this.setState({ groups: [], error: error.message }),
    );
  }

  /** What one answer leaves unread the next ones tell; another process of the server may know less. */
  told({ areas: groups, unread, left_out: leftOut }, times) {
    if (!this.state.groups || unread <= this.state.unread) this.setState({ groups, unread, leftOut });
    if (times && unread) this.reading = setTimeout(() => this.load(times - 1), READING.pause);
  }

  render() {
    const { groups, error } = this.state;
    if (error) return <div className="vc-body"><Notice kind="error">{error}</Notice></div>;
    if (!groups) return <p className="vc-body vc-quiet"><Spinner /> {_("Looking through the project …")}</p>;
    if (!groups.length) {
      return (
        <div className="vc-body vc-empty">
          {this.renderMissing()}
          <p><strong>{_("Nothing to compare yet")}</strong></p>
          <p className="vc-quiet">
            {_("Save a measurement, then measure it again in another task of this project: its volume over time " +
              "appears here.")}
          </p>
        </div>
      );
    }
    const most = groups.slice().sort((a, b) => b.rows.length - a.rows.length);
    const group = most.find(({ area_key: key }) => key === this.state.chosen) || most[0];
    const rows = compared(group.rows);
    return (
      <div className="vc-body">
        {this.renderMissing()}
        <Select label={_("Area")} value={group.area_key} onChange={(chosen) => this.setState({ chosen })}
          options={most.map(({ area_key: key, name, rows }) => ({ key, text: `${name} (${rows.length})` }))} />
        {rows.length > 1 ? this.renderChart(rows) : (
          <p className="vc-quiet">{_("Measured in one task only: measure it again in another, under \"Saved\".")}</p>
        )}
        {this.renderTable(rows)}
      </div>
    );
  }

  renderMissing() {
    const { unread, leftOut } = this.state;
    const unreadWords = fill(_("%(count)s saved measurements of an older version are still being read …"), { count: unread });
    const leftWords = fill(_("%(count)s saved measurements are not shown here: open them under \"Saved\" in their task."),
      { count: leftOut });
    return (
      <>
        {unread ? <Notice>{unreadWords}</Notice> : null}
        {leftOut ? <Notice>{leftWords}</Notice> : null}
      </>
    );
  }

  renderTable(rows) {
    const { units, onOpen } = this.props;
    return (
      <div className="vc-scroll">
        <table className="vc-table">
          <thead>
            <tr>
              <th scope="col">{_("Task")}</th>
              <th scope="col" className="vc-right">{fill(_("Net, %(unit)s"), { unit: units.volumeUnit })}</th>
              <th scope="col" className="vc-right">±</th>
              <th scope="col" className="vc-right">{_("Change")}</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((row, index) => (
              <React.Fragment key={row.measurement + row.task}>
                <tr className={row.apart.length ? "vc-goes-on" : null}>
                  <th scope="row">
                    <button type="button" className="vc-link" onClick={() => onOpen(row.measurement, row.task)}>
                      {row.task_name || row.task}
                    </button>
                    <div className="vc-quiet">{when(row.date, false)} · {quantityWords(row, units)}</div>
                  </th>
                  <td className="vc-right">{units.volumeNumber(row.volume_m3, row.std_m3)}</td>
                  <td className="vc-right">{units.margin(row.std_m3).replace("± ", "")}</td>
                  <td className="vc-right">{index ? this.renderChange(row, rows[index - 1]) : ""}</td>
                </tr>
                {row.apart.length ? <tr className="vc-apart"><td colSpan={4}>{this.apart(row)}</td></tr> : null}
              </React.Fragment>
            ))}
          </tbody>
        </table>
      </div>
    );
  }

  /** Why a row is not compared with the latest. */
  apart({ comparable, apart }) {
    return fill(_("%(why)s: not compared with the latest"), { why: apartWords(comparable, apart, this.props.units) });
  }

  /** By how much a volume has changed since the last one that it may be compared with. */
  renderChange(row, above) {
    const { units } = this.props;
    const { before } = row;
    if (!before) return "–";
    const by = row.volume_m3 - before.volume_m3;
    const std = Math.hypot(before.std_m3 || 0, row.std_m3 || 0);
    return (
      <>
        {`${by > 0 ? "+" : ""}${units.volumeNumber(by, std)}`}
        {before.measurement === above.measurement && before.task === above.task ? null : (
          <div className="vc-quiet">{fill(_("since %(date)s"), { date: when(before.date, false) })}</div>
        )}
      </>
    );
  }

  renderChart(all) {
    const { units } = this.props;
    const rows = all.filter(({ volume_m3: volume }) => Number.isFinite(volume));
    const values = rows.flatMap(({ volume_m3: v, std_m3: s }) => [v - 1.96 * (s || 0), v + 1.96 * (s || 0)])
      .map((value) => value * units.perCubicMetre);
    const [low, high] = [Math.min(0, ...values), Math.max(0, ...values)];
    const times = rows.map(({ date }) => new Date(date).getTime());
    const [first, last] = [Math.min(...times), Math.max(...times)];
    const x = (index) => LEFT + 10 + (last > first
      ? (times[index] - first) / (last - first)
      : index / Math.max(rows.length - 1, 1)) * (WIDTH - LEFT - RIGHT - 20);
    const y = (value) => HEIGHT - BOTTOM - (value - low) / (high - low || 1) * (HEIGHT - BOTTOM - TOP);
    const at = (row) => y(row.volume_m3 * units.perCubicMetre);
    const up = ticks(low, high, 4);
    return (
      <figure className="vc-chart">
        <figcaption>{fill(_("Net volume, %(unit)s, with 95 % intervals"), { unit: units.volumeUnit })}</figcaption>
        <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label={_("The table below has the same numbers.")}>
          {up.map((tick) => (
            <g key={tick}>
              <line className="vc-grid" x1={LEFT} x2={WIDTH - RIGHT} y1={y(tick)} y2={y(tick)} />
              <text x={LEFT - 4} y={y(tick) + 3} textAnchor="end">{tickText(tick, up)}</text>
            </g>
          ))}
          <polyline className="vc-line" points={rows.map((row, index) => (row.apart.length ? "" : `${x(index)},${at(row)}`)).join(" ")} />
          {rows.map((row, index) => {
            const reach = 1.96 * (row.std_m3 || 0) * units.perCubicMetre;
            const value = row.volume_m3 * units.perCubicMetre;
            return (
              <g key={row.measurement + row.task} className={row.apart.length ? "vc-dot vc-hollow" : "vc-dot"}>
                {row.apart.length ? <title>{this.apart(row)}</title> : null}
                <line x1={x(index)} x2={x(index)} y1={y(value - reach)} y2={y(value + reach)} />
                <circle cx={x(index)} cy={at(row)} r="3.5" />
              </g>
            );
          })}
          <text x={LEFT} y={HEIGHT - 4}>{when(first, false)}</text>
          <text x={WIDTH - RIGHT} y={HEIGHT - 4} textAnchor="end">{when(last, false)}</text>
        </svg>
        {rows.some(({ apart }) => apart.length) ? (
          <div className="vc-quiet">{_("Hollow: measured otherwise than the latest, and not compared with it.")}</div>
        ) : null}
      </figure>
    );
  }
}
