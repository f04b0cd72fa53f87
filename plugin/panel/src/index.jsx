// What main.js loads on the map page: the control on the map, and the panel that it opens.

import L from "leaflet";
import React from "React";
import ReactDOM from "ReactDOM";
import { _ } from "./gettext";
import Panel from "./Panel";
import "./panel.css";

const PILE = "M2 20.5h22M4 20.5c3.6-1 4.9-12 9-12s5.4 11 9 12M8.3 16.4h9.4M10 12.4h6";

const Control = L.Control.extend({
  options: { position: "topright" },

  onAdd(map) {
    const bar = L.DomUtil.create("div", "leaflet-control-volcalc leaflet-bar leaflet-control");
    const button = L.DomUtil.create("a", "leaflet-bar-part theme-secondary", bar);
    Object.entries({
      href: "#volcalc",
      role: "button",
      title: _("Volume (VolCalc)"),
      "aria-label": _("Volume (VolCalc)"),
      "aria-expanded": "false",
    }).forEach(([name, value]) => button.setAttribute(name, value));
    button.appendChild(icon());
    L.DomEvent.disableClickPropagation(bar);
    button.addEventListener("click", (event) => {
      event.preventDefault();
      this.toggle();
    });
    button.addEventListener("keydown", (event) => {
      if (event.key !== " ") return;
      event.preventDefault();
      this.toggle();
    });
    this.button = button;
    this.dock = L.DomUtil.create("div", "volcalc-dock", map.getContainer());
    L.DomEvent.disableClickPropagation(this.dock);
    L.DomEvent.disableScrollPropagation(this.dock);
    return bar;
  },

  onRemove() {
    ReactDOM.unmountComponentAtNode(this.dock);
    this.dock.remove();
  },

  toggle() {
    if (this.isOpen) this.close();
    else this.open();
  },

  open() {
    this.isOpen = true;
    this.button.setAttribute("aria-expanded", "true");
    this.button.classList.add("selected");
    this.dock.hidden = false;
    this._map.getContainer().classList.add("volcalc-open");
    ReactDOM.render(
      <Panel ref={(panel) => (this.panel = panel)} map={this._map} tasks={this.options.tasks}
        shown onClose={() => this.close()} />,
      this.dock,
      () => this.panel && this.panel.focus(),
    );
  },

  // The panel stays alive: what was drawn and measured is there when it is opened again.
  close() {
    this.isOpen = false;
    this.button.setAttribute("aria-expanded", "false");
    this.button.classList.remove("selected");
    this.dock.hidden = true;
    this._map.getContainer().classList.remove("volcalc-open");
    ReactDOM.render(
      <Panel ref={(panel) => (this.panel = panel)} map={this._map} tasks={this.options.tasks}
        shown={false} onClose={() => this.close()} />,
      this.dock,
    );
    this.button.focus();
  },
});

function icon() {
  const name = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(name, "svg");
  svg.setAttribute("viewBox", "0 0 26 26");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(name, "path");
  path.setAttribute("d", PILE);
  svg.appendChild(path);
  return svg;
}

/** Add the control to a map of these tasks; with `open`, show the panel at once. */
export default function addVolume({ map, tasks, open }) {
  const control = new Control({ tasks });
  map.addControl(control);
  if (open) control.open();
  return control;
}
