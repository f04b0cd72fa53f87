// The cloud's coordinate system and units, where it does not say them or says them wrong.

import React from "React";
import { _ } from "./gettext";
import { Field, Select } from "./ui";
import { UNITS } from "./words";

export default class CoordinatesStep extends React.Component {
  render() {
    const { info, form, wrong, onChange } = this.props;
    const units = (silent) => [
      { key: "", text: silent },
      ...UNITS.map(([key, words]) => ({ key, text: words() })),
    ];
    const says = info.has_crs ? _("As the cloud says") : _("Not known");
    const hint = info.has_crs
      ? _("Goes before what the cloud says.")
      : _("The cloud does not say where it is. With this, areas have a place in it.");
    return (
      <div className="vc-step">
        <Field label={_("Coordinate system")} wrong={wrong.crs} hint={hint}>
          <input type="text" className={`form-control${wrong.crs ? " vc-wrong" : ""}`} value={form.crs}
            placeholder={info.has_crs ? _("as the cloud says") : "EPSG:32633"} autoComplete="off" spellCheck={false}
            aria-invalid={Boolean(wrong.crs)} onChange={(event) => onChange({ crs: event.target.value })} />
        </Field>
        <Select label={_("Unit of heights")} value={form.verticalUnit} options={units(says)}
          onChange={(verticalUnit) => onChange({ verticalUnit })} />
        {form.crs ? null : (
          <Select label={_("Unit of lengths")} value={form.sourceUnit} options={units(says)}
            onChange={(sourceUnit) => onChange({ sourceUnit })} />
        )}
      </div>
    );
  }
}
