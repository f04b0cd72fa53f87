// The buttons of a 3-D page, as WebODM asks plugins for them: with the viewer, and nothing else.
PluginsAPI.ModelView.triggerAddActionButton({ viewer: {} }, (button) =>
  ReactDOM.render(button, document.getElementById("row")));
