// Shape, method and slices: what most measurements leave as it is.

import React from "React";
import CoordinatesStep from "./CoordinatesStep";
import { _ } from "./gettext";
import { Check, Field, Fold, Select } from "./ui";

export default class Advanced extends React.Component {
  state = { open: false };

  said() {
    const { form } = this.props;
    const shape = form.shape === "object" ? _("closed body") : _("terrain");
    return form.slicing === "auto" ? shape : `${shape}, ${_("own slices")}`;
  }

  render() {
    const { info, form, wrong, onChange, units } = this.props;
    const asked = ["slices", "sliceHeight", "maxGap", "floorElevation", "crs"].some((key) => wrong[key]);
    return (
      <Fold title={_("Advanced")} said={this.said()} open={this.state.open || asked}
        onToggle={(open) => this.setState({ open })}>
        <Select label={_("Shape")} value={form.shape} onChange={(shape) => onChange({ shape })}
          options={[
            { key: "terrain", text: _("Terrain: a surface against a base") },
            { key: "object", text: _("Closed body, scanned all round") },
          ]} />
        {form.shape === "object" ? this.renderBody() : (
          <Select label={_("Two surfaces in one place")} value={form.layer} onChange={(layer) => onChange({ layer })}
            options={[
              { key: "upper", text: _("The upper one: a roof, a crown") },
              { key: "lower", text: _("The lower one: what is under it") },
              { key: "mean", text: _("Their mean") },
            ]} />
        )}
        <Select label={_("Slices")} value={form.slicing} onChange={(slicing) => onChange({ slicing })}
          options={[
            { key: "auto", text: _("Automatic") },
            { key: "count", text: _("A number of slices") },
            { key: "height", text: _("Slices of a height") },
          ]} />
        {form.slicing === "count" ? (
          <Field label={_("Number")} short value={form.slices} wrong={wrong.slices}
            onChange={(slices) => onChange({ slices })} />
        ) : null}
        {form.slicing === "height" ? (
          <Field label={_("Height")} short value={form.sliceHeight} unit={units.lengthUnit} wrong={wrong.sliceHeight}
            onChange={(sliceHeight) => onChange({ sliceHeight })} />
        ) : null}
        {form.control === "none" ? (
          <Check label={_("Leave out the map projection's scale (grid instead of ground)")} checked={form.grid}
            onChange={(grid) => onChange({ grid })} />
        ) : null}
        {info.has_crs ? <CoordinatesStep info={info} form={form} wrong={wrong} onChange={onChange} /> : null}
      </Fold>
    );
  }

  renderBody() {
    const { form, wrong, onChange, units } = this.props;
    return (
      <div>
        <Select label={_("Method")} value={form.method} onChange={(method) => onChange({ method })}
          options={[
            { key: "section", text: _("Sections: concave, hollow and several bodies") },
            { key: "polar", text: _("Polar: the paper's, for one simple body") },
          ]} />
        {form.method === "polar" ? (
          <Check label={_("End slices centred on the lowest and highest point")} checked={form.centerCaps}
            onChange={(centerCaps) => onChange({ centerCaps })} />
        ) : (
          <div>
            <Check label={_("Hollow: what would hold water is empty")} checked={form.hollow}
              onChange={(hollow) => onChange({ hollow })} />
            <Field label={_("Largest gap")} short value={form.maxGap} unit={units.lengthUnit} wrong={wrong.maxGap}
              placeholder={_("automatic")} onChange={(maxGap) => onChange({ maxGap })} />
            <Select label={_("Floor")} value={form.floor} onChange={(floor) => onChange({ floor })}
              options={[
                { key: "auto", text: _("Automatic") },
                { key: "none", text: _("None: closed by its own points") },
                { key: "plane", text: _("A plane under its edge") },
                { key: "elevation", text: _("At an elevation") },
              ]} />
            {form.floor === "elevation" ? (
              <Field label={_("Elevation")} short value={form.floorElevation} unit={units.lengthUnit}
                wrong={wrong.floorElevation} onChange={(floorElevation) => onChange({ floorElevation })} />
            ) : null}
          </div>
        )}
      </div>
    );
  }
}
