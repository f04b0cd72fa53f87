// A SystemJS loader for what is on the page already.
exports.fetch = function (load) {
  return load.name.split("/").pop();
};
exports.instantiate = function (load) {
  return window[load.source] || window[load.metadata.exports];
};
