// A page with a map, as WebODM makes one: ?task=ID:NAME (several of them) &project=P &theme=dark.
(function () {
  "use strict";

  const asked = new URLSearchParams(window.location.search);
  const project = Number(asked.get("project")) || 1;
  const tasks = asked.getAll("task").map((text) => {
    const [id, ...name] = text.split(":");
    return { id, name: name.join(":"), project, public: false, epsg: 32615 };
  });
  document.documentElement.classList.toggle("dark", asked.get("theme") === "dark");

  const map = L.map("map", { zoomControl: false, maxZoom: 24, zoomAnimation: false, fadeAnimation: false });
  map.attributionControl.setPrefix("");
  map.setView([46.84302, -91.99525], 20);
  const image = asked.get("image");
  if (image) L.imageOverlay(image, JSON.parse(asked.get("bounds"))).addTo(map);
  L.control.zoom({ position: "bottomleft" }).addTo(map);
  window.hostMap = map;

  const layers = [];
  const List = L.Control.extend({
    options: { position: "topright" },
    onAdd() {
      const box = L.DomUtil.create("div", "leaflet-bar leaflet-control host-layers");
      L.DomEvent.disableClickPropagation(box);
      this.box = box;
      return box;
    },
    update() {
      this.box.textContent = "";
      layers.forEach(({ layer, name }) => {
        const row = L.DomUtil.create("label", "", this.box);
        const tick = L.DomUtil.create("input", "", row);
        tick.type = "checkbox";
        tick.checked = map.hasLayer(layer);
        tick.onchange = () => PluginsAPI.Map.toggleAnnotation(layer, tick.checked);
        L.DomUtil.create("span", "", row).textContent = name;
        const remove = L.DomUtil.create("button", "", row);
        remove.textContent = "×";
        remove.title = "Delete";
        remove.onclick = () => PluginsAPI.Map.deleteAnnotation(layer);
      });
    },
  });
  const list = new List();
  map.addControl(list);
  PluginsAPI.Map.onAddAnnotation((layer, name) => {
    layers.push({ layer, name });
    list.update();
  });
  PluginsAPI.Map.onUpdateAnnotation((layer, name) => {
    layers.filter((row) => row.layer === layer).forEach((row) => (row.name = name));
    list.update();
  });
  PluginsAPI.Map.onAnnotationDeleted((layer) => {
    const at = layers.findIndex((row) => row.layer === layer);
    if (at >= 0) layers.splice(at, 1);
    list.update();
  });

  map.on("click", (event) => {
    if (PluginsAPI.Map.handleClick(event)) return;
    L.popup().setLatLng(event.latlng).setContent("The host's own pop-up").openOn(map);
  });

  const units = document.getElementById("units");
  units.value = localStorage.getItem("unit_system") || "metric";
  units.onchange = () => {
    localStorage.setItem("unit_system", units.value);
    document.dispatchEvent(new CustomEvent("onUnitSystemChanged", { detail: units.value }));
  };

  // The same task has one tile for each of its layers.
  const tiles = tasks.flatMap((task) => ["orthophoto", "dsm"].map((type) => ({ type, meta: { task } })));
  if (asked.get("row")) {
    const task = { ...tasks[0], ...JSON.parse(asked.get("row")) };
    PluginsAPI.Dashboard.triggerAddTaskActionButton({ task }, (button) =>
      ReactDOM.render(button, document.getElementById("row")));
  } else {
    PluginsAPI.Map.triggerWillAddControls({ map, tiles });
  }
})();
