// A SystemJS loader for style sheets: ready when the sheet is.
exports.fetch = function (load) {
  return new Promise(function (resolve, reject) {
    var link = document.createElement("link");
    link.rel = "stylesheet";
    link.href = load.address;
    link.onload = function () { resolve(""); };
    link.onerror = function () { reject(new Error("no style sheet at " + load.address)); };
    document.head.appendChild(link);
  });
};
