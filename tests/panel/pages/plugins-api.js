// The interface that plugins see, as far as this one uses it: endpoints to which a plugin adds
// things, functions that plugins answer, and SystemJS with the page's globals as modules.
(function () {
  "use strict";

  function endpoint(api, name) {
    const callbacks = [];
    api[name] = (callback) => callbacks.push(callback);
    api[`trigger${name[0].toUpperCase()}${name.slice(1)}`] = (args, answer) =>
      callbacks.forEach((callback) => {
        const result = callback(args);
        if (answer) setTimeout(() => answer(result), 0);
      });
  }

  function answered(api, name) {
    const suffix = name[0].toUpperCase() + name.slice(1);
    let callbacks = [];
    api[name] = (...args) => callbacks.some((callback) => callback(...args));
    api[`on${suffix}`] = (callback) => callbacks.push(callback);
    api[`off${suffix}`] = (callback) => (callbacks = callbacks.filter((other) => other !== callback));
  }

  const Map = {};
  const Dashboard = {};
  const ModelView = {};
  endpoint(Map, "willAddControls");
  endpoint(Dashboard, "addTaskActionButton");
  endpoint(ModelView, "addActionButton");
  ["handleClick", "addAnnotation", "updateAnnotation", "deleteAnnotation", "toggleAnnotation", "annotationDeleted"]
    .forEach((name) => answered(Map, name));

  const { SystemJS } = window;
  SystemJS.config({
    baseURL: "/plugins",
    map: { "host-css": "/pages/host-css.js", "host-global": "/pages/host-global.js" },
    meta: {
      "*.css": { loader: "host-css" },
      React: { loader: "host-global" },
      ReactDOM: { loader: "host-global" },
      leaflet: { loader: "host-global", exports: "L" },
    },
  });
  window.PluginsAPI = { Map, Dashboard, ModelView, SystemJS };
})();
