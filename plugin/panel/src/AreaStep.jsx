// Step one: which area. Drawn, from a file, the task's crop, or everything.

import L from "leaflet";
import React from "React";
import { EDITABLE_VERTICES } from "./draw";
import { polygonArea, readAreas } from "./geometry";
import { _, fill } from "./gettext";
import { lookAt } from "./layers";
import { Button, Choice, FilePick, Icon, IconButton, Notice } from "./ui";

export default class AreaStep extends React.Component {
  choose = (area) => {
    const { editor, onChange } = this.props;
    if (area === "file" && this.props.form.area !== "file") onChange({ area, file: null });
    else onChange({ area });
    if (editor.drawing) editor.stopDrawing();
  };

  read = (text, name) => {
    const { info, editor, onChange, onError } = this.props;
    try {
      const file = { name, ...readAreas(text, info.limits) };
      onError(null);
      onChange({ file });
      if (!this.props.map) return;
      editor.load(file.geojson);
      lookAt(this.props.map, L.geoJSON(file.geojson).getBounds());
    } catch (error) {
      onError(`${name}: ${error.message}`);
    }
  };

  render() {
    const { info, form, map } = this.props;
    const object = form.shape === "object";
    const noPlace = info.has_crs ? "" : _("The cloud is not georeferenced: only all of it can be measured.");
    const noMap = map ? "" : _("The task has no orthophoto or elevation model to draw on.");
    const options = [
      { key: "draw", text: _("Draw"), icon: "draw", disabled: object || !info.has_crs || !map, hint: noPlace || noMap },
      { key: "file", text: _("File"), icon: "file", disabled: object || !info.has_crs, hint: noPlace || _("GeoJSON") },
      {
        key: "auto",
        text: _("Find"),
        icon: "find",
        disabled: object,
        hint: _("Finds the stockpiles: whatever stands out from the ground"),
      },
      {
        key: "crop",
        text: _("Crop"),
        icon: "crop",
        disabled: object || !info.crop,
        hint: info.crop ? _("The area that the task is cropped to") : _("This task has no crop area."),
      },
      { key: "whole", text: _("All"), icon: "cloud", hint: _("The whole point cloud") },
    ];
    const value = object ? "whole" : form.area;
    return (
      <div className="vc-step vc-area">
        <div className="vc-label">{_("Area")}</div>
        <Choice name="volcalc-area" label={_("Area")} value={value} options={options} onChange={this.choose} />
        {this.renderChoice(value, object)}
        {noMap ? (
          <p className="vc-quiet">
            {noMap} {info.has_crs ? _("The whole cloud, the task's crop and areas from a file can be measured.") : noPlace}
          </p>
        ) : null}
      </div>
    );
  }

  renderChoice(value, object) {
    if (value === "draw") return this.renderDrawing();
    if (value === "file") return this.renderFile();
    if (value === "auto") {
      return <p className="vc-quiet">{_("Finds what stands out from the ground and measures each pile. Take its outlines into the form afterwards with \"Change\", to edit them.")}</p>;
    }
    if (value === "crop") return <p className="vc-quiet">{_("Measures inside the task's crop area.")}</p>;
    return (
      <p className="vc-quiet">
        {object
          ? _("A closed body is measured whole, all round. Terrain, under \"Advanced\", is measured by area.")
          : _("Measures the whole cloud, from its outer edge.")}
      </p>
    );
  }

  renderDrawing() {
    const { editor } = this.props;
    if (editor.drawing) {
      return (
        <div className="vc-tools">
          <p className="vc-quiet" role="status">{this.drawingWords()}</p>
          <Button onClick={() => editor.finish()} primary disabled={editor.points < 3}>
            <Icon name="ok" /> {_("Close outline")}
          </Button>
          <Button onClick={() => editor.undo()}><Icon name="undo" /> {_("Undo")}</Button>
          <Button onClick={() => editor.stopDrawing()}>{_("Cancel")}</Button>
        </div>
      );
    }
    if (!editor.areas.length) {
      return (
        <div className="vc-tools">
          <p className="vc-quiet">{_("Draw round what is to be measured, a little outside its foot.")}</p>
          <Button primary onClick={this.begin}><Icon name="draw" /> {_("Draw on the map")}</Button>
          {editor.canUndo ? <Button onClick={() => editor.undo()}><Icon name="undo" /> {_("Undo")}</Button> : null}
        </div>
      );
    }
    return <div>{this.renderAreas()}{this.renderEditing()}</div>;
  }

  begin = () => {
    const { editor } = this.props;
    editor.startArea();
    editor.map.getContainer().focus({ preventScroll: true });
  };

  drawingWords() {
    const { points, open } = this.props.editor;
    const what = open.area === null ? _("Click round the area.") : _("Click round the hole.");
    if (points < 3) return `${what} ${_("Keyboard: arrows move the map, Space sets a point.")}`;
    return _("Click the first point, double-click, or press Enter to close.");
  }

  renderAreas() {
    const { editor, units } = this.props;
    return (
      <ul className="vc-areas">
        {editor.areas.map(({ name, rings }, index) => (
          <li key={index}>
            <input className="form-control" value={name} maxLength={80} aria-label={_("Name of the area")}
              placeholder={fill(_("Area %(number)s"), { number: index + 1 })}
              onChange={(event) => editor.rename(index, event.target.value)} />
            <span className="vc-number">≈ {units.area(polygonArea(rings), 3)}</span>
            <IconButton icon="hole" label={_("Cut a hole into this area")} onClick={() => this.hole(index)} />
            <IconButton icon="trash" label={_("Remove this area")} onClick={() => editor.removeArea(index)} />
          </li>
        ))}
      </ul>
    );
  }

  hole(index) {
    const { editor } = this.props;
    editor.startHole(index);
    editor.map.getContainer().focus({ preventScroll: true });
  }

  renderEditing() {
    const { editor } = this.props;
    return (
      <div className="vc-tools">
        {editor.problem ? <Notice kind="warning">{editor.problem}</Notice> : null}
        <Button onClick={this.begin}><Icon name="plus" /> {_("Another area")}</Button>
        <Button onClick={() => editor.undo()} disabled={!editor.canUndo}><Icon name="undo" /> {_("Undo")}</Button>
        {editor.selected
          ? <Button onClick={() => editor.removeSelected()}><Icon name="trash" /> {_("Remove point")}</Button>
          : null}
      </div>
    );
  }

  renderFile() {
    const { form, info, editor, map } = this.props;
    const { file } = form;
    const editable = map && file && file.vertices <= EDITABLE_VERTICES;
    return (
      <div>
        <div className="vc-tools">
          <FilePick label={file ? _("Another file") : _("Choose GeoJSON")} accept=".geojson,.json,application/geo+json"
            limit={info.limits.area_bytes} onText={this.read} onError={this.props.onError} />
          {file ? <span className="vc-quiet vc-clip" title={file.name}>{file.name}</span> : null}
        </div>
        {editable ? <div>{this.renderAreas()}{this.renderEditing()}</div> : null}
        {file && !editable
          ? <p className="vc-quiet">{fill(_("%(count)s areas, %(vertices)s vertices"), file)}</p>
          : null}
        {!file && !editor.areas.length
          ? <p className="vc-quiet">{_("Polygons in longitude and latitude (WGS 84); each becomes a result.")}</p>
          : null}
      </div>
    );
  }
}
