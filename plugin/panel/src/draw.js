// Drawing areas on the map: outlines with vertices that can be dragged, holes, undo.
//
// Clicks set points; the first point, a second click on the last one, or Enter closes the ring.
// Without a mouse: the arrows move the map, Space sets a point at the cross in its middle; a
// vertex that has the focus moves with the arrows and goes with Delete.

import L from "leaflet";
import { fault, polygonArea, toAreas, toGeoJSON } from "./geometry";
import { _ } from "./gettext";
import { mapIsBusy } from "./clicks";

const NEAR_PX = 10;
const NUDGE_PX = 4;
const HISTORY = 100;
export const EDITABLE_VERTICES = 500; // more handles than that, and the map stands still

const STYLES = {
  area: { color: "#f5a623", weight: 3, fillOpacity: 0.14, interactive: false },
  open: { color: "#f5a623", weight: 3, dashArray: "6 5", interactive: false },
  rubber: { color: "#f5a623", weight: 2, dashArray: "2 6", opacity: 0.9, interactive: false },
};

export class AreaEditor {
  constructor(map, onChange) {
    this.map = map;
    this.onChange = onChange;
    this.areas = []; // [{name, rings: [[[lon, lat], ...], ...], found}], outline first, then holes
    this.open = null; // the ring being drawn: {area, ring: [[lon, lat], ...]}; area null for a new one
    this.selected = null; // {area, ring, point}
    this.history = [];
    this.shapes = L.layerGroup();
    this.handles = L.layerGroup();
    this.rubber = L.polyline([], STYLES.rubber);
    this.cross = null;
    this.shown = false;
  }

  // What the panel asks.

  get drawing() {
    return this.open !== null;
  }

  get points() {
    return this.open ? this.open.ring.length : 0;
  }

  get areaM2() {
    return this.areas.reduce((sum, area) => sum + polygonArea(area.rings), 0);
  }

  get problem() {
    return this.areas.map((area) => fault(area.rings)).find(Boolean) || null;
  }

  get vertices() {
    return this.areas.reduce((n, { rings }) => n + rings.reduce((m, ring) => m + ring.length, 0), 0);
  }

  toGeoJSON() {
    return toGeoJSON(this.areas);
  }

  // What the panel does.

  show(shown) {
    if (this.shown === shown) return;
    this.shown = shown;
    [this.shapes, this.handles].forEach((layer) => (shown ? layer.addTo(this.map) : layer.remove()));
    if (!shown) this.stopDrawing();
    this.redraw();
  }

  startArea() {
    this.begin({ area: null, ring: [] });
  }

  startHole(area = this.areas.length - 1) {
    this.begin({ area, ring: [] });
  }

  load(geojson) {
    this.remember();
    this.areas = toAreas(geojson);
    this.changed();
  }

  rename(area, name) {
    this.areas[area].name = name;
    this.onChange();
  }

  removeArea(area) {
    this.remember();
    this.areas.splice(area, 1);
    this.selected = null;
    this.changed();
  }

  removeSelected() {
    if (!this.selected) return;
    const { area, ring, point } = this.selected;
    this.remember();
    const { rings } = this.areas[area];
    if (rings[ring].length > 3) rings[ring].splice(point, 1);
    else if (ring > 0) rings.splice(ring, 1);
    else this.areas.splice(area, 1);
    this.selected = null;
    this.changed();
  }

  undo() {
    if (this.open && this.open.ring.length) {
      this.open.ring.pop();
      this.changed();
    } else if (this.open) {
      this.stopDrawing();
    } else if (this.history.length) {
      this.areas = JSON.parse(this.history.pop());
      this.selected = null;
      this.changed();
    }
  }

  get canUndo() {
    return this.drawing || this.history.length > 0;
  }

  clear() {
    if (this.areas.length) this.remember();
    this.areas = [];
    this.selected = null;
    this.stopDrawing();
  }

  finish() {
    if (!this.open || this.open.ring.length < 3) return;
    const { area, ring } = this.open;
    this.remember();
    if (area === null) this.areas.push({ name: "", rings: [ring] });
    else this.areas[area].rings.push(ring);
    this.stopDrawing();
  }

  stopDrawing() {
    if (this.open) {
      mapIsBusy(this.map, false);
      this.map.off("click", this.clicked, this).off("mousemove", this.moved, this);
      this.map.getContainer().removeEventListener("keydown", this.keyed);
      this.map.getContainer().classList.remove("volcalc-drawing");
      this.rubber.remove();
      if (this.cross) this.cross.remove();
      this.cross = null;
      // The double click that closed the ring must not zoom.
      setTimeout(() => this.map.doubleClickZoom.enable(), 300);
    }
    this.open = null;
    this.changed();
  }

  destroy() {
    this.onChange = () => {};
    this.show(false);
  }

  // Drawing a ring.

  begin(open) {
    if (this.open) this.stopDrawing();
    this.open = open;
    this.selected = null;
    mapIsBusy(this.map, true);
    this.map.doubleClickZoom.disable();
    this.map.on("click", this.clicked, this).on("mousemove", this.moved, this);
    this.map.getContainer().addEventListener("keydown", this.keyed);
    this.map.getContainer().classList.add("volcalc-drawing");
    this.rubber.setLatLngs([]).addTo(this.map);
    this.changed();
  }

  clicked({ latlng }) {
    const { ring } = this.open;
    if (ring.length >= 3 && (this.isNear(latlng, ring[0]) || this.isNear(latlng, ring[ring.length - 1]))) {
      this.finish();
    } else if (!ring.length || !this.isNear(latlng, ring[ring.length - 1], 3)) {
      ring.push([latlng.lng, latlng.lat]);
      this.changed();
    }
  }

  moved({ latlng }) {
    const { ring } = this.open;
    if (ring.length) this.rubber.setLatLngs([toLatLng(ring[ring.length - 1]), latlng, toLatLng(ring[0])]);
  }

  keyed = (event) => {
    if (event.target !== this.map.getContainer()) return;
    if (event.key === " ") {
      event.preventDefault();
      this.showCross();
      this.clicked({ latlng: this.map.getCenter() });
    } else if (event.key.startsWith("Arrow")) {
      this.showCross();
    } else if (event.key === "Enter") {
      this.finish();
    } else if (event.key === "Escape") {
      this.stopDrawing();
    } else if (event.key === "Backspace" || (event.key === "z" && (event.ctrlKey || event.metaKey))) {
      event.preventDefault();
      this.undo();
    }
  };

  showCross() {
    if (!this.cross) this.cross = L.DomUtil.create("div", "volcalc-cross", this.map.getContainer());
  }

  isNear(latlng, point, pixels = NEAR_PX) {
    const [a, b] = [latlng, toLatLng(point)].map((at) => this.map.latLngToContainerPoint(at));
    return a.distanceTo(b) <= pixels;
  }

  remember() {
    this.history.push(JSON.stringify(this.areas));
    if (this.history.length > HISTORY) this.history.shift();
  }

  changed() {
    this.redraw();
    this.onChange();
  }

  // What is on the map.

  redraw() {
    this.shapes.clearLayers();
    this.handles.clearLayers();
    if (!this.shown) return;
    this.polygons = this.areas.map(({ rings }) =>
      L.polygon(rings.map((ring) => ring.map(toLatLng)), STYLES.area).addTo(this.shapes));
    if (this.open) {
      const { ring } = this.open;
      L.polyline(ring.map(toLatLng), STYLES.open).addTo(this.shapes);
      ring.forEach((point, i) => this.openVertex(point, i === 0 && ring.length >= 3));
      return;
    }
    if (this.vertices > EDITABLE_VERTICES) return;
    this.areas.forEach(({ rings }, area) => rings.forEach((points, ring) => {
      points.forEach((_point, point) => this.vertex({ area, ring, point }));
      if (this.vertices < 300) points.forEach((_point, point) => this.midpoint({ area, ring, point }));
    }));
  }

  openVertex(point, closes) {
    const marker = handle(point, closes ? "volcalc-vertex volcalc-closes" : "volcalc-vertex",
      { interactive: closes, title: closes ? _("Close the outline") : "" });
    if (closes) marker.on("click", () => this.finish());
    marker.addTo(this.handles);
  }

  vertex(place) {
    const { area, ring, point } = place;
    const points = this.areas[area].rings[ring];
    const chosen = JSON.stringify(place) === JSON.stringify(this.selected);
    const marker = handle(points[point], `volcalc-vertex${chosen ? " volcalc-chosen" : ""}`,
      { draggable: true, title: _("Drag to move; Delete removes the point") });
    marker
      .on("dragstart", () => this.remember())
      .on("drag", ({ latlng }) => this.place(points, point, area, latlng))
      .on("dragend", () => this.changed())
      .on("click", () => this.select(place))
      .addTo(this.handles);
    marker.getElement().addEventListener("keydown", (event) => this.vertexKeyed(event, place, marker));
    marker.getElement().dataset.place = `${area}-${ring}-${point}`;
  }

  midpoint({ area, ring, point }) {
    const points = this.areas[area].rings[ring];
    const next = points[(point + 1) % points.length];
    const middle = [(points[point][0] + next[0]) / 2, (points[point][1] + next[1]) / 2];
    const insert = () => {
      this.remember();
      points.splice(point + 1, 0, middle);
    };
    handle(middle, "volcalc-midpoint", { draggable: true, title: _("Drag to add a point"), keyboard: false })
      .on("dragstart", insert)
      .on("drag", ({ latlng }) => this.place(points, point + 1, area, latlng))
      .on("dragend", () => this.changed())
      .on("click", () => {
        insert();
        this.select({ area, ring, point: point + 1 });
      })
      .addTo(this.handles);
  }

  place(points, point, area, latlng) {
    points[point] = [latlng.lng, latlng.lat];
    this.polygons[area].setLatLngs(this.areas[area].rings.map((ring) => ring.map(toLatLng)));
    this.onChange();
  }

  select(place) {
    this.selected = place;
    this.changed();
    const { area, ring, point } = place;
    const again = this.map.getContainer().querySelector(`[data-place="${area}-${ring}-${point}"]`);
    if (again) again.focus({ preventScroll: true });
  }

  vertexKeyed(event, place, marker) {
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (event.key === "Delete" || event.key === "Backspace") {
      this.selected = place;
      this.removeSelected();
    } else if (moves[event.key]) {
      const step = L.point(moves[event.key]).multiplyBy(NUDGE_PX);
      const at = this.map.latLngToContainerPoint(marker.getLatLng()).add(step);
      this.remember();
      const points = this.areas[place.area].rings[place.ring];
      const latlng = this.map.containerPointToLatLng(at);
      points[place.point] = [latlng.lng, latlng.lat];
      this.select(place);
    } else {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
  }
}

function handle(point, className, options) {
  const icon = L.divIcon({ className, iconSize: null });
  return L.marker(toLatLng(point), { icon, keyboard: true, zIndexOffset: 1000, ...options });
}

function toLatLng([lon, lat]) {
  return L.latLng(lat, lon);
}
