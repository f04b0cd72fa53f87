// A result on the map, and in WebODM's list of layers (there among the annotations).

import L from "leaflet";
import { _, fill } from "./gettext";
import { unitSystem } from "./units";

const SMALL_PX = 120;
const BASE64 = /^[A-Za-z0-9+/]+={0,2}$/;
const shownLayers = new Set();
let listening = false;

/** Put a measurement's layers on the map; returns how to take them off again. */
export function showResult(map, task, document) {
  listen(map);
  const name = document.name || _("Volume");
  const added = [
    [sound(reliefLayer, document), fill(_("%(name)s: cut and fill"), { name })],
    [sound(outlinesLayer, document), fill(_("%(name)s: slices"), { name })],
    [sound(proposalsLayer, document), fill(_("%(name)s: proposed outlines"), { name })],
  ].filter(([layer]) => layer !== null);
  added.forEach(([layer, title]) => {
    shownLayers.add(layer);
    layer.addTo(map);
    // WebODM keeps its list in React state and reads it anew: one layer per turn.
    setTimeout(() => shownLayers.has(layer) && window.PluginsAPI.Map.addAnnotation(layer, title, task), 0);
  });
  return {
    bounds: boundsOf(added.map(([layer]) => layer)),
    rename: (newName) => added.forEach(([layer, title]) =>
      window.PluginsAPI.Map.updateAnnotation(layer, title.replace(name, () => newName))),
    remove: () => added.forEach(([layer]) => removeLayer(layer)),
  };
}

/** Whether these bounds are all in view, and large enough to be looked at. */
export function isInView(map, bounds) {
  if (!bounds) return true;
  const size = map.latLngToContainerPoint(bounds.getSouthEast())
    .subtract(map.latLngToContainerPoint(bounds.getNorthWest()));
  return map.getBounds().contains(bounds) && Math.max(size.x, size.y) > SMALL_PX;
}

/** Show these bounds in the part of the map that the panel leaves free. */
export function lookAt(map, bounds) {
  if (!bounds || !bounds.isValid()) return;
  const dock = map.getContainer().querySelector(".volcalc-dock");
  const { x, y } = map.getSize();
  const covered = dock && !dock.hidden ? [dock.offsetWidth, dock.offsetHeight] : [0, 0];
  const sheet = covered[0] > x * 0.8;
  map.fitBounds(bounds, {
    maxZoom: 23,
    paddingTopLeft: [sheet || covered[0] > x / 2 ? 20 : covered[0] + 30, 20],
    paddingBottomRight: [20, sheet ? Math.min(covered[1] + 10, y - 80) : 20],
  });
}

function sound(make, document) {
  try {
    return make(document);
  } catch (e) {
    return null; // the shapes of a saved file that are none
  }
}

function removeLayer(layer) {
  if (!shownLayers.delete(layer)) return false;
  layer.remove();
  setTimeout(() => window.PluginsAPI.Map.annotationDeleted(layer), 0);
  return true;
}

// The list only tells plugins what was clicked; each looks after its own layers.
function listen(map) {
  if (listening) return;
  listening = true;
  const { Map } = window.PluginsAPI;
  Map.onToggleAnnotation((layer, visible) => {
    if (!shownLayers.has(layer)) return false;
    if (visible) layer.addTo(map);
    else layer.remove();
    return true;
  });
  Map.onDeleteAnnotation(removeLayer);
}

function boundsOf(layers) {
  const bounds = L.latLngBounds([]);
  layers.forEach((layer) => bounds.extend(layer.getBounds()));
  return bounds.isValid() ? bounds : null;
}

function reliefLayer({ layers, area }) {
  const parts = (layers || []).map(({ relief }) => relief).filter(soundRelief).map(({ png, bounds }) =>
    L.imageOverlay(`data:image/png;base64,${png}`, bounds, { className: "volcalc-relief", opacity: 0.85 }));
  if (area) {
    parts.push(L.geoJSON(area, {
      style: { color: "#f5a623", weight: 2.5, fill: false },
      interactive: false,
    }));
  }
  return parts.length ? L.featureGroup(parts) : null;
}

// Saved files may come from anywhere: a picture that is none, or bounds without numbers, is left out.
function soundRelief(relief) {
  return Boolean(relief) && typeof relief.png === "string" && BASE64.test(relief.png) &&
    Array.isArray(relief.bounds) && relief.bounds.flat().length === 4 &&
    relief.bounds.flat().every(Number.isFinite);
}

function outlinesLayer({ layers }) {
  const parts = (layers || []).map(({ outlines }) => outlines)
    .filter((outlines) => outlines && outlines.features && outlines.features.length)
    .map((outlines) => {
      const heights = outlines.features.map(({ properties }) => (properties || {}).z_m || 0);
      const [low, high] = [Math.min(...heights), Math.max(...heights)];
      return L.geoJSON(outlines, {
        filter: ({ geometry }) => Boolean(geometry) && geometry.type !== "Point",
        style: ({ properties }) => outlineStyle((properties || {}).z_m || 0, low, high),
        onEachFeature: ({ properties }, layer) => layer.bindTooltip(() => sliceWords(properties || {}),
          { sticky: true, className: "volcalc-tooltip" }),
      });
    });
  return parts.length ? L.featureGroup(parts) : null;
}

function proposalsLayer({ layers }) {
  const parts = (layers || []).map(({ proposal }) => proposal).filter(Boolean).map((proposal) =>
    L.geoJSON(proposal, {
      style: { color: "#40c057", weight: 2.5, dashArray: "6 5", fill: false },
      interactive: false,
    }));
  return parts.length ? L.featureGroup(parts) : null;
}

function outlineStyle(z, low, high) {
  const share = high > low ? (z - low) / (high - low) : 0.5;
  const color = z < 0 && low < 0 ? "#74c0fc" : `hsl(${48 - 30 * share}, 100%, ${72 - 22 * share}%)`;
  return { color, weight: 1.6, opacity: 0.95, fill: false };
}

function sliceWords({ z_m: z, area_m2: area }) {
  const units = unitSystem();
  const words = document.createElement("span");
  words.textContent = `${_("Height")} ${units.length(z)} · ${units.area(area)}`;
  return words;
}
