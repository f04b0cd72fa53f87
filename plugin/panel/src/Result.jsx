// What came out: the volume first and large, then what it is made of and what it rests on.

import React from "React";
import { Acting, askDrop } from "./acting";
import Chart from "./Chart";
import { _, fill } from "./gettext";
import { NameField, Rename } from "./Naming";
import { Bases, Budget, Details, Legend } from "./ResultParts";
import { percent } from "./units";
import { baseName, warningWords, when } from "./words";
import { Button, Fold, Icon, IconButton, Notice } from "./ui";

export default class Result extends Acting {
  state = { asking: null, busy: null, error: null, chosen: 0 };

  /** How long a result that is not saved is there. */
  keptWords() {
    const { own } = this.props;
    if (!own) return _("This result was dropped in another window: it cannot be saved any more.");
    if (!own.kept_until) return _("Not saved yet.");
    return fill(_("Not saved yet. Kept for you until %(date)s."), { date: when(own.kept_until) });
  }

  render() {
    const { doc, unsaved, own, units, info } = this.props;
    const { measurement } = doc;
    const result = measurement.results[this.state.chosen] || {};
    return (
      <div className="vc-form">
        <div className="vc-body">
          {this.renderHead()}
          {measurement.results.length > 1 ? this.renderResults() : null}
          {result.error
            ? <Notice kind="error">{units.sentence(result.error)}</Notice>
            : this.renderResult(result)}
          {warningWords(measurement).map((words) => (
            <Notice key={words} kind="warning">{units.sentence(words)}</Notice>
          ))}
          <Details doc={doc} units={units} />
        </div>
        <div className="vc-foot theme-secondary">
          {own && info.can_change ? (
            <NameField suggested={doc.name} busy={this.state.busy === "save"}
              onSave={(name) => this.act("save", () => this.props.onSave(name))} />
          ) : null}
          {this.renderError("save")}
          {unsaved ? null : this.renderExport()}
        </div>
      </div>
    );
  }

  renderHead() {
    const { doc, unsaved, own, info, onNew, onBack, onEdit, onRename } = this.props;
    const meta = [when(doc.date), doc.user].filter(Boolean).join(" · ");
    return (
      <div className="vc-result-head">
        {unsaved ? (
          <div className="vc-tools">
            <Button onClick={onNew}><Icon name="back" /> {_("New measurement")}</Button>
            <Button onClick={() => onEdit(doc)} title={_("Change the area or the settings and measure again")}>
              <Icon name="pencil" /> {_("Change")}
            </Button>
            <IconButton icon="trash" label={_("Drop this result")} disabled={!own}
              onClick={() => this.setState({ asking: "drop" })} />
            <p className="vc-quiet">{this.keptWords()}</p>
            {this.state.asking === "drop" ? this.renderAsk("drop", { ...askDrop(), doing: this.props.onDrop }) : null}
            {this.renderError("drop")}
          </div>
        ) : (
          <div>
            <Button onClick={onBack}><Icon name="back" /> {_("All measurements")}</Button>
            <Rename name={doc.name} may={info.can_change} onRename={(name) => onRename(doc, name)} />
            <div className="vc-quiet">{meta}</div>
          </div>
        )}
      </div>
    );
  }

  renderResults() {
    const { doc, units } = this.props;
    return (
      <table className="vc-table vc-pick">
        <thead>
          <tr><th scope="col">{_("Area")}</th><th scope="col" className="vc-right">{_("Net")}</th></tr>
        </thead>
        <tbody>
          {doc.measurement.results.map((result, index) => (
            <tr key={result.name} className={index === this.state.chosen ? "vc-on" : ""}>
              <th scope="row">
                <button type="button" className="vc-link" aria-pressed={index === this.state.chosen}
                  onClick={() => this.setState({ chosen: index })}>
                  {result.name}
                </button>
              </th>
              <td className="vc-right">
                {result.error ? _("failed") : `${units.volume(result.volume_m3, result.std_m3)} ${units.margin(result.std_m3)}`}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    );
  }

  renderResult(result) {
    const { doc, units, onMap, onPropose, info, here } = this.props;
    const terrain = doc.measurement.shape === "terrain";
    const layer = (doc.layers || [])[this.state.chosen];
    const [low, high] = result.interval95_m3 || [];
    return (
      <div>
        {warningWords(result).map((words) => (
          <Notice key={words} kind="warning">{units.sentence(words)}</Notice>
        ))}
        {layer && layer.proposal && onMap && info.can_run && here ? (
          <div className="vc-tools">
            <Button primary onClick={() => onPropose(doc, this.state.chosen)}
              title={_("Measures again with the dashed outline on the map")}>
              <Icon name="ok" /> {_("Use the proposed outline")}
            </Button>
          </div>
        ) : null}
        <div className="vc-hero">
          <div className="vc-hero-word">{terrain ? _("Net volume, cut less fill") : _("Enclosed volume")}</div>
          <div className="vc-hero-number">
            {units.volumeNumber(result.volume_m3, result.std_m3)}
            <span className="vc-hero-unit"> {units.volumeUnit}</span>
            <span className="vc-hero-margin"> {units.margin(result.std_m3)}</span>
          </div>
          {result.interval95_m3 ? (
            <div className="vc-quiet">
              {fill(_("95 % interval: %(low)s to %(high)s"),
                { low: units.volumeNumber(low, result.std_m3), high: units.volume(high, result.std_m3) })}
            </div>
          ) : null}
        </div>
        {terrain ? (
          <div className="vc-cards">
            {this.renderPart("cut", _("Cut"), _("above the base"), result.cut_m3, result.cut_std_m3)}
            {this.renderPart("fill", _("Fill"), _("below the base"), result.fill_m3, result.fill_std_m3)}
          </div>
        ) : null}
        <dl className="vc-facts">{this.facts(result).map(([word, value]) => (
          <div key={word}><dt>{word}</dt><dd>{value}</dd></div>
        ))}</dl>
        {result.slices && result.slices.length ? <Chart result={result} terrain={terrain} units={units} /> : null}
        {onMap && layer && layer.relief ? <Legend relief={layer.relief} units={units} terrain={terrain} /> : null}
        <Fold title={_("What the error is made of")} said={units.margin(result.std_m3)}>
          <Budget result={result} units={units} />
        </Fold>
        {result.bases ? (
          <Fold title={_("Other bases")} said={fill(_("%(count)s compared"), { count: result.bases.length })} open>
            <Bases result={result} units={units} />
          </Fold>
        ) : null}
      </div>
    );
  }

  renderPart(kind, word, where, value, std) {
    const { units } = this.props;
    return (
      <div className={`vc-card vc-${kind}`}>
        <div className="vc-card-word">{word} <span className="vc-quiet">{where}</span></div>
        <div className="vc-card-number">{units.volume(value, std)}</div>
        <div className="vc-quiet">{units.margin(std)}</div>
      </div>
    );
  }

  facts(result) {
    const { doc, units } = this.props;
    const terrain = doc.measurement.shape === "terrain";
    return [
      [_("Area"), units.area(result.area_m2)],
      [_("Highest"), units.length(result.max_height_m)],
      [terrain ? _("Mass of the cut") : _("Mass"), result.mass_t === null || result.mass_t === undefined ? null : units.mass(result.mass_t, result.mass_std_t)],
      [_("Base"), terrain && result.base !== null ? baseName(result.base, units) : null],
      [_("Covered by points"), Number.isFinite(result.coverage) ? percent(result.coverage) : null],
    ].filter(([, value]) => value !== null);
  }

  renderExport() {
    const { doc, api, units } = this.props;
    const formats = [["html", _("Report")], ["csv", "CSV"], ["geojson", "GeoJSON"]];
    return (
      <div className="vc-tools vc-export" role="group" aria-label={_("Export")}>
        {this.props.info.can_run ? (
          <Button onClick={() => this.props.onEdit(doc)} title={_("Take its area and settings into a new measurement")}>
            <Icon name="pencil" /> {_("Change")}
          </Button>
        ) : null}
        {formats.map(([format, text]) => (
          <a key={format} className="btn btn-sm btn-secondary vc-plain" download
            href={api.exportUrl(doc.id, format, units.report)}>
            {format === "html" ? <Icon name="download" /> : null} {text}
          </a>
        ))}
      </div>
    );
  }
}
