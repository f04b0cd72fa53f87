// WebODM opens a pop-up on every click on its map unless a plugin says that the click is its own.

let busyMaps = new Set();
let asked = false;

export function mapIsBusy(map, busy) {
  if (!asked && window.PluginsAPI) {
    window.PluginsAPI.Map.onHandleClick((event) => busyMaps.has(event.target));
    asked = true;
  }
  if (busy) {
    busyMaps.add(map);
  } else {
    // Not before the click that ended the drawing has reached WebODM as well.
    setTimeout(() => busyMaps.delete(map), 0);
  }
}
