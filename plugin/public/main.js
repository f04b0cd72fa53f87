/* Where WebODM shows "Volume (VolCalc)": the dashboard, the map and the 3-D view. This script is on
   every page, so it stays small; the panel itself is loaded where it is shown. */
(function () {
  "use strict";

  var HASH = "#volcalc";
  var COMPLETED = 40;
  var POINT_CLOUD = /^georeferenced_model\.(laz|las)$/;
  var MAP_LAYER = /^(orthophoto|dsm|dtm)\.tif$/;

  function words(text) {
    return typeof window.gettext === "function" ? window.gettext(text) : text;
  }

  function has(task, pattern) {
    return (task.available_assets || []).some(function (asset) {
      return pattern.test(asset);
    });
  }

  function whyNot(task) {
    if ("status" in task && task.status !== COMPLETED) return words("The task is not completed yet.");
    if (!has(task, POINT_CLOUD)) return words("The task has no point cloud. Process it again with one.");
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

  function button(className, reason, onClick, ref) {
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
          onClick: onClick,
          ref: ref,
        },
        icon(),
        " ",
        title
      )
    );
  }

  function goTo(url) {
    return function () {
      window.location.href = url;
    };
  }

  // WebODM's map page fails on a task that has no layer; its 3-D page needs none.
  PluginsAPI.Dashboard.addTaskActionButton(function (args) {
    var task = args.task;
    var page = has(task, MAP_LAYER) ? "/map" : "/3d";
    return button("btn-primary", whyNot(task), goTo(page + "/project/" + task.project + "/task/" + task.id + "/" + HASH));
  });

  function load() {
    var system = window.SystemJS || PluginsAPI.SystemJS;
    return Promise.all([system.import("volcalc/build/main.js"), system.import("volcalc/build/main.css")])
      .then(function (loaded) {
        return loaded[0];
      });
  }

  function notLoaded(error) {
    // WebODM itself would say nothing.
    console.error("Volume (VolCalc): the panel cannot be loaded. Reload the page; after an upgrade of " +
      "the plugin, restart WebODM.", error);
  }

  // The 3-D page tells plugins the viewer alone; its task is written on the page.
  function taskOfModel() {
    var place = document.querySelector("[data-modelview]");
    try {
      return JSON.parse(place.getAttribute("data-task"));
    } catch (e) {
      return null;
    }
  }

  function mapOfModel() {
    var path = window.location.pathname;
    var own = path.match(/\/3d\/project\/([^/]+)\/task\/([^/]+)\//);
    var open = path.match(/\/public\/task\/([^/]+)\/(iframe\/)?3d\//);
    if (own) return "/map/project/" + own[1] + "/task/" + own[2] + "/" + HASH;
    if (open) return "/public/task/" + open[1] + "/" + (open[2] || "") + "map/" + HASH;
    return null;
  }

  PluginsAPI.ModelView.addActionButton(function () {
    var task = taskOfModel();
    var map = mapOfModel();
    if (task && !has(task, MAP_LAYER)) return buttonBesideModel(task);
    return map ? button("btn-secondary", task && whyNot(task), goTo(map)) : null;
  });

  function buttonBesideModel(task) {
    var element = null;
    var wanted = window.location.hash === HASH;
    function toggle() {
      load().then(function (loaded) {
        var parent = document.querySelector(".model-view");
        loaded.besideModel({ parent: parent, task: task, button: element }).toggle();
      }).catch(notLoaded);
    }
    return button("btn-secondary", whyNot(task), toggle, function (made) {
      element = made;
      if (made && wanted && !made.disabled) toggle();
      wanted = false;
    });
  }

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
    load().then(function (loaded) {
      var add = loaded.default || loaded;
      add({ map: args.map, tasks: tasks, open: window.location.hash === HASH });
    }).catch(notLoaded);
  });
})();
