// Scale bars: two clicks on the map each, and the length that was measured between them.

import L from "leaflet";
import { mapIsBusy } from "./clicks";
import { retyped, unitSystem } from "./units";

const TAPE_M = 0.01; // what a tape is good for, unless told otherwise
const LINE = { color: "#7ed321", weight: 4, interactive: false };

export class ScaleBars {
  constructor(map, onChange) {
    this.map = map;
    this.onChange = onChange;
    this.bars = []; // [{from, to, length, accuracy}]; places are [lon, lat], lengths are typed texts
    this.first = null; // the first end of the bar that is being set
    this.picking = false;
    this.layer = L.layerGroup();
  }

  show(shown) {
    if (shown) this.layer.addTo(this.map);
    else this.layer.remove();
    if (!shown) this.stop();
  }

  start() {
    this.stop();
    this.picking = true;
    mapIsBusy(this.map, true);
    this.map.doubleClickZoom.disable();
    this.map.on("click", this.clicked, this);
    this.map.getContainer().addEventListener("keydown", this.keyed);
    this.map.getContainer().classList.add("volcalc-drawing");
    this.changed();
  }

  stop() {
    if (!this.picking) return;
    this.picking = false;
    this.first = null;
    mapIsBusy(this.map, false);
    this.map.off("click", this.clicked, this);
    this.map.getContainer().removeEventListener("keydown", this.keyed);
    this.map.getContainer().classList.remove("volcalc-drawing");
    setTimeout(() => this.map.doubleClickZoom.enable(), 300);
    this.changed();
  }

  clicked({ latlng }) {
    const place = [latlng.lng, latlng.lat];
    if (!this.first) {
      this.first = place;
      this.changed();
      return;
    }
    const accuracy = retyped(String(TAPE_M), Number(unitSystem().perMetre.toPrecision(1)));
    this.bars.push({ from: this.first, to: place, length: "", accuracy });
    this.stop();
  }

  keyed = (event) => {
    if (event.target !== this.map.getContainer()) return;
    if (event.key === "Escape") {
      this.stop();
    } else if (event.key === " ") {
      event.preventDefault();
      this.clicked({ latlng: this.map.getCenter() });
    }
  };

  set(index, values) {
    Object.assign(this.bars[index], values);
    this.onChange();
  }

  /** Other units: the typed lengths stay as long as they are. */
  convert(factor) {
    this.bars.forEach((bar) => {
      bar.length = retyped(bar.length, factor);
      bar.accuracy = retyped(bar.accuracy, factor);
    });
  }

  remove(index) {
    this.bars.splice(index, 1);
    this.changed();
  }

  destroy() {
    this.onChange = () => {};
    this.show(false);
  }

  changed() {
    this.redraw();
    this.onChange();
  }

  redraw() {
    this.layer.clearLayers();
    this.bars.forEach((bar, index) => {
      const line = L.polyline([latLng(bar.from), latLng(bar.to)], LINE).addTo(this.layer);
      this.end(bar, "from", line);
      this.end(bar, "to", line);
      L.marker(line.getBounds().getCenter(), {
        icon: L.divIcon({ className: "volcalc-bar-number", html: String(index + 1), iconSize: null }),
        interactive: false,
        keyboard: false,
      }).addTo(this.layer);
    });
    if (this.first) this.marker(this.first, { interactive: false });
  }

  end(bar, which, line) {
    this.marker(bar[which], { draggable: true })
      .on("drag", ({ latlng }) => {
        bar[which] = [latlng.lng, latlng.lat];
        line.setLatLngs([latLng(bar.from), latLng(bar.to)]);
      })
      .on("dragend", () => this.changed());
  }

  marker(place, options) {
    const icon = L.divIcon({ className: "volcalc-bar-end", iconSize: null });
    return L.marker(latLng(place), { icon, keyboard: false, ...options }).addTo(this.layer);
  }
}

function latLng([lon, lat]) {
  return L.latLng(lat, lon);
}
