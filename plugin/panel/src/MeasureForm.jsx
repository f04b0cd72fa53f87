// What to measure, and how. One column of steps; what most people leave alone is folded.

import React from "React";
import Advanced from "./Advanced";
import AreaStep from "./AreaStep";
import ControlStep from "./ControlStep";
import CoordinatesStep from "./CoordinatesStep";
import { basesOf, wrongFields } from "./form";
import { _ } from "./gettext";
import { baseHint, baseName } from "./words";
import { Check, Field, Notice, Select } from "./ui";

export default class MeasureForm extends React.Component {
  state = { tried: false };

  /** Why measuring cannot begin yet; null when it can. */
  missing(wrong) {
    const { form, editor, info } = this.props;
    const area = form.shape === "object" ? "whole" : form.area;
    const drawn = editor.areas.length > 0;
    if (area === "draw" && editor.drawing) return _("Close the outline first.");
    if (area === "draw" && !drawn) return _("Draw an area on the map first.");
    if (area === "file" && !form.file) return _("Choose a file with areas first.");
    if ((area === "draw" || area === "file") && editor.problem) return editor.problem;
    if (area === "crop" && !info.crop) return _("The task has no crop area.");
    return Object.values(wrong)[0] || null;
  }

  measure = (event) => {
    event.preventDefault();
    this.setState({ tried: true });
    const { form, bars, onMeasure } = this.props;
    if (!this.missing(wrongFields(form, bars.bars))) onMeasure();
  };

  render() {
    const { info, form, units, editor, bars, map, children, onChange, onError } = this.props;
    if (!info.can_run) return <div className="vc-body">{children}<Notice>{info.reason}</Notice></div>;
    const wrong = wrongFields(form, bars.bars);
    const missing = this.missing(wrong);
    const shownWrong = this.state.tried ? wrong : {};
    const placed = { ...info, has_crs: info.has_crs || Boolean(form.crs.trim()) };
    return (
      <form className="vc-form" onSubmit={this.measure} noValidate>
        <div className="vc-body">
          {children}
          {info.has_crs ? null : <CoordinatesStep info={info} form={form} wrong={shownWrong} onChange={onChange} />}
          <AreaStep info={placed} form={form} units={units} editor={editor} map={map} onChange={onChange} onError={onError} />
          {form.shape === "terrain" ? this.renderBase(shownWrong) : null}
          {this.renderDensity(shownWrong)}
          <ControlStep info={placed} form={form} units={units} bars={bars} map={map} wrong={shownWrong} onChange={onChange}
            onError={onError} />
          <Advanced info={info} form={form} units={units} wrong={shownWrong} onChange={onChange} />
        </div>
        <div className="vc-foot theme-secondary">
          <button type="submit" className="btn btn-primary vc-run" disabled={Boolean(missing) && !this.isTyping(wrong)}
            aria-describedby="volcalc-missing">
            {_("Measure volume")}
          </button>
          <div id="volcalc-missing" className="vc-quiet" role="status">{missing}</div>
        </div>
      </form>
    );
  }

  /** A wrong field is pointed out when measuring is tried; the button stays alive for that. */
  isTyping(wrong) {
    return Object.keys(wrong).length > 0;
  }

  renderBase(wrong) {
    const { info, form, units, onChange } = this.props;
    const options = basesOf(info).map((key) => ({ key, text: baseName(key, units) }));
    return (
      <div className="vc-step">
        <Select label={_("Base")} value={form.base} onChange={(base) => onChange({ base })} hint={baseHint(form.base)}
          options={options} />
        {form.base === "elevation" ? (
          <Field label={_("Elevation")} short value={form.elevation} unit={units.lengthUnit} wrong={wrong.elevation}
            onChange={(elevation) => onChange({ elevation })} />
        ) : null}
        {form.area === "draw" || form.area === "file" ? (
          <Check label={_("Move each outline to the toe that the terrain shows")} checked={form.toe}
            onChange={(toe) => onChange({ toe })} />
        ) : null}
      </div>
    );
  }

  renderDensity(wrong) {
    const { form, units, onChange } = this.props;
    return (
      <div className="vc-step vc-pair">
        <Field label={_("Density")} short value={form.density} unit={units.densityUnit} wrong={wrong.density}
          placeholder={_("none")} onChange={(density) => onChange({ density })} />
        {form.density ? (
          <Field label={_("± sigma")} short value={form.densitySigma} unit={units.densityUnit}
            placeholder="0" wrong={wrong.densitySigma} onChange={(densitySigma) => onChange({ densitySigma })} />
        ) : null}
      </div>
    );
  }
}

