// What main.js loads: on the map page the control and the panel that it opens, in the 3-D view of a task
// without a map the panel alone.

import L from "leaflet";
import React from "React";
import ReactDOM from "ReactDOM";
import { _ } from "./gettext";
import Panel from "./Panel";
import "./panel.css";

const PILE = "M2 20.5h22M4 20.5c3.6-1 4.9-12 9-12s5.4 11 9 12M8.3 16.4h9.4M10 12.4h6";

/** The panel in its place on a page; `button` opens and closes it. */
class Dock {
  constructor(parent, { map, tasks, button }) {
    Object.assign(this, { map, tasks, button, parent, isOpen: false });
    this.element = L.DomUtil.create("div", map ? "volcalc-dock" : "volcalc-dock volcalc-beside", parent);
    this.element.hidden = true;
    L.DomEvent.disableClickPropagation(this.element);
    L.DomEvent.disableScrollPropagation(this.element);
    button.setAttribute("aria-expanded", "false");
  }

  // The panel stays alive when it is closed: what was drawn and measured is there when it is opened again.
  toggle = (open = !this.isOpen) => {
    this.isOpen = open;
    this.button.setAttribute("aria-expanded", String(open));
    this.button.classList.toggle("selected", open);
    this.element.hidden = !open;
    this.parent.classList.toggle("volcalc-open", open);
    ReactDOM.render(
      <Panel ref={(panel) => (this.panel = panel)} map={this.map} tasks={this.tasks} shown={open}
        onClose={() => this.toggle(false)} />,
      this.element,
      () => open && this.panel && this.panel.focus(),
    );
    if (!open) this.button.focus();
  };

  remove() {
    ReactDOM.unmountComponentAtNode(this.element);
    this.element.remove();
  }
}

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
    }).forEach(([name, value]) => button.setAttribute(name, value));
    button.appendChild(icon());
    L.DomEvent.disableClickPropagation(bar);
    this.dock = new Dock(map.getContainer(), { map, tasks: this.options.tasks, button });
    const toggled = (event) => {
      event.preventDefault();
      this.dock.toggle();
    };
    button.addEventListener("click", toggled);
    button.addEventListener("keydown", (event) => event.key === " " && toggled(event));
    return bar;
  },

  onRemove() {
    this.dock.remove();
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
  if (open) control.dock.toggle();
  return control;
}

/** The panel on a page without a map, above `parent`; the same one for each call. */
export function besideModel({ parent, task, button }) {
  if (!parent.volcalcDock) parent.volcalcDock = new Dock(parent, { map: null, tasks: [task], button });
  return parent.volcalcDock;
}
