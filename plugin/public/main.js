/* Where WebODM shows "Volume (VolCalc)": the dashboard, the map and the 3-D view. This script is on
   every page, so it stays small; the panel itself is loaded where there is a map. */
(function () {
  "use strict";

  var HASH = "#volcalc";
  var COMPLETED = 40;
  var POINT_CLOUD = /^georeferenced_model\.(laz|las)$/;
  var MAP_LAYER = /^(orthophoto|dsm|dtm)\.tif$/;

  function words(text) {
    return typeof window.gettext === "function" ? window.gettext(text) : text;
  }

  function has(assets, pattern) {
    return assets.some(function (asset) {
      return pattern.test(asset);
    });
  }

  function whyNot(task) {
    var assets = task.available_assets || [];
    if (task.status !== COMPLETED) return words("The task is not completed yet.");
    if (!has(assets, POINT_CLOUD)) return words("The task has no point cloud. Process it again with one.");
    if (!has(assets, MAP_LAYER)) return words("The task has no map to draw on (no orthophoto or elevation model).");
    return null;
  }

  function icon() {
    return React.createElement(
      "svg",
      { viewBox: "0 0 26 26", width: 16, height: 16, "aria-hidden": "true", fill: "none", stroke: "currentColor",
        strokeWidth: 2, strokeLinecap: "round", strokeLinejoin: "round", style: { verticalAlign: "-3px" } },
      React.createElement("path", {
        d: "M2 20.5h22M4 20.5c3.6-1 4.9-12 9-12s5.4 11 9 12M8.3 16.4h9.4M10 12.4h6",
      })
    );
  }

  function button(className, url, reason) {
    var title = words("Volume (VolCalc)");
    return React.createElement(
      "span",
      { title: reason || "", className: "volcalc-open" },
      React.createElement(
        "button",
        {
          type: "button",
          className: "btn btn-sm " + className,
          disabled: Boolean(reason),
          "aria-label": reason ? title + ": " + reason : title,
          title: reason || title,
          onClick: function () {
            window.location.href = url;
          },
        },
        icon(),
        " ",
        title
      )
    );
  }

  PluginsAPI.Dashboard.addTaskActionButton(function (args) {
    var task = args.task;
    return button("btn-primary", "/map/project/" + task.project + "/task/" + task.id + "/" + HASH, whyNot(task));
  });

  PluginsAPI.ModelView.addActionButton(function () {
    var path = window.location.pathname;
    var own = path.match(/\/3d\/project\/([^/]+)\/task\/([^/]+)\//);
    var open = path.match(/\/public\/task\/([^/]+)\/(iframe\/)?3d\//);
    if (own) return button("btn-secondary", "/map/project/" + own[1] + "/task/" + own[2] + "/" + HASH, null);
    if (open) return button("btn-secondary", "/public/task/" + open[1] + "/" + (open[2] || "") + "map/" + HASH, null);
    return null;
  });

  function tasksOf(tiles) {
    var ids = {};
    return tiles
      .map(function (tile) {
        return tile.meta.task;
      })
      .filter(function (task) {
        return task && !ids[task.id] && (ids[task.id] = true);
      });
  }

  PluginsAPI.Map.willAddControls(function (args) {
    var tasks = tasksOf(args.tiles);
    if (!tasks.length) return;
    var load = window.SystemJS || PluginsAPI.SystemJS;
    Promise.all([load.import("volcalc/build/main.js"), load.import("volcalc/build/main.css")])
      .then(function (loaded) {
        var add = loaded[0].default || loaded[0];
        add({ map: args.map, tasks: tasks, open: window.location.hash === HASH });
      })
      .catch(function (error) {
        // WebODM itself would say nothing.
        console.error("Volume (VolCalc): the panel cannot be loaded. Reload the page; after an upgrade of " +
          "the plugin, restart WebODM.", error);
      });
  });
})();
