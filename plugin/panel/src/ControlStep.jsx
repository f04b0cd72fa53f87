// Relative control: how large the cloud really is, from a file or from lengths clicked on the map.

import React from "React";
import { distance } from "./geometry";
import { _, fill } from "./gettext";
import { typed } from "./units";
import { Button, Choice, Field, FilePick, Fold, Icon, IconButton, Select } from "./ui";

export default class ControlStep extends React.Component {
  state = { open: this.props.form.control !== "none" };

  said() {
    const { form, bars } = this.props;
    if (form.control === "file") return form.controlFile ? form.controlFile.name : _("file");
    if (form.control === "bars") return fill(_("%(count)s scale bars"), { count: bars.bars.length });
    return _("as delivered");
  }

  choose = (control) => {
    const { bars, onChange } = this.props;
    onChange({ control });
    if (control !== "bars") bars.stop();
  };

  render() {
    const { form, onChange, wrong } = this.props;
    const options = [
      { key: "none", text: _("None") },
      { key: "bars", text: _("Scale bars"), disabled: !this.props.info.has_crs || !this.props.map,
        hint: this.props.map ? "" : _("There is no map to click on.") },
      { key: "file", text: _("File") },
    ];
    return (
      <Fold title={_("Scale")} className="vc-scale" said={this.said()} open={this.state.open || Boolean(wrong.control)}
        onToggle={(open) => this.setState({ open })}>
        <Choice name="volcalc-control" label={_("Control points")} value={form.control} options={options}
          onChange={this.choose} />
        {form.control === "bars" ? this.renderBars() : null}
        {form.control === "file" ? this.renderFile() : null}
        {form.control === "none"
          ? <p className="vc-quiet">{_("Lengths measured on site bring the cloud to its true size.")}</p>
          : null}
        {wrong.control ? <div className="vc-said vc-said-wrong" role="alert">{wrong.control}</div> : null}
        {form.control !== "none" ? this.renderFit(onChange) : null}
      </Fold>
    );
  }

  renderFit(onChange) {
    const { form } = this.props;
    return (
      <div>
        {form.control === "file" ? (
          <Select label={_("Fit")} value={form.scaleMode} onChange={(scaleMode) => onChange({ scaleMode })}
            options={[
              { key: "auto", text: _("What the points allow") },
              { key: "scale", text: _("Scale only") },
              { key: "shift", text: _("Scale and shift") },
              { key: "full", text: _("Scale, shift and rotation") },
            ]} />
        ) : null}
        {form.control === "file" ? (
          <Select label={_("Area is")} value={form.areaFrame} onChange={(areaFrame) => onChange({ areaFrame })}
            options={[
              { key: "cloud", text: _("drawn on the map: it moves with the cloud") },
              { key: "control", text: _("surveyed: it stays where it is") },
            ]} />
        ) : null}
      </div>
    );
  }

  renderFile() {
    const { form, info, onChange, onError } = this.props;
    return (
      <div className="vc-tools">
        <FilePick label={form.controlFile ? _("Another file") : _("Choose control file")}
          accept=".yaml,.yml,.json,.txt" limit={info.limits.control_bytes} onError={onError}
          onText={(text, name) => onChange({ controlFile: { text, name } })} />
        <span className="vc-quiet vc-clip">
          {form.controlFile ? form.controlFile.name : _("YAML or JSON with points and taped distances, or gcp_list.txt")}
        </span>
      </div>
    );
  }

  renderBars() {
    const { bars, units } = this.props;
    return (
      <div>
        <ol className="vc-bars">
          {bars.bars.map((bar, index) => this.renderBar(bar, index))}
        </ol>
        <div className="vc-tools">
          {bars.picking ? (
            <p className="vc-quiet" role="status">
              {bars.first ? _("Click the bar's other end.") : _("Click one end of the bar.")}
            </p>
          ) : null}
          {bars.picking
            ? <Button onClick={() => bars.stop()}>{_("Cancel")}</Button>
            : <Button primary={!bars.bars.length} onClick={this.begin}><Icon name="plus" /> {_("Add a scale bar")}</Button>}
        </div>
        {!bars.bars.length && !bars.picking ? (
          <p className="vc-quiet">
            {fill(_("Click the two ends of something whose length you taped, and type the length in %(unit)s."),
              { unit: units.lengthUnit })}
          </p>
        ) : null}
      </div>
    );
  }

  begin = () => {
    const { bars, map } = this.props;
    bars.start();
    map.getContainer().focus({ preventScroll: true });
  };

  renderBar(bar, index) {
    const { bars, units } = this.props;
    const onMap = distance(bar.from, bar.to);
    const given = typed(bar.length);
    const factor = given > 0 ? given / units.perMetre / onMap : null;
    return (
      <li key={index}>
        <div className="vc-pair">
          <Field label={_("Measured length")} short value={bar.length} unit={units.lengthUnit}
            onChange={(length) => bars.set(index, { length })} />
          <Field label={_("± sigma")} short value={bar.accuracy} unit={units.lengthUnit}
            onChange={(accuracy) => bars.set(index, { accuracy })} />
          <IconButton icon="trash" label={_("Remove this scale bar")} onClick={() => bars.remove(index)} />
        </div>
        <div className="vc-quiet">
          {fill(_("on the map, level: %(length)s"), { length: units.length(onMap) })}
          {factor ? ` · × ${factor.toFixed(3)}` : ""}
        </div>
      </li>
    );
  }
}
