(function () {
  "use strict";
  var holder = document.getElementById("scene");
  if (!holder) { return; }
  var spec = JSON.parse(document.getElementById("scene-data").textContent);
  var letters = ["x", "y", "z"];

  // In an orthographic scene, plotly.js draws one unit of the aspect ratio over half the height
  // of the scene: dividing the ranges by the half height to be shown fits the content, and keeps
  // the three axes equal.
  function aspect(view) {
    var half = Math.max(view.half_height, view.half_width * holder.clientHeight / holder.clientWidth);
    var ratio = {};
    letters.forEach(function (letter) {
      var range = spec.layout.scene[letter + "axis"].range;
      ratio[letter] = (range[1] - range[0]) / (1.12 * half);
    });
    return ratio;
  }

  function copy(value) { return JSON.parse(JSON.stringify(value)); }

  spec.layout.scene.aspectratio = aspect(spec.views[Object.keys(spec.views)[0]]);
  // One of plotly.js's buttons would upload the model to its maker: it is taken away, the address
  // it uses is emptied, and the page's security policy forbids the rest.
  var config = {
    displaylogo: false, responsive: true, plotlyServerURL: "",
    modeBarButtonsToRemove: ["sendChartToCloud", "tableRotation"]
  };
  Plotly.newPlot(holder, spec.data, copy(spec.layout), config);

  document.querySelectorAll("input[data-switch]").forEach(function (box) {
    box.addEventListener("change", function () {
      var traces = spec.switches[Number(box.dataset.switch)].traces;
      Plotly.restyle(holder, { visible: box.checked }, traces);
    });
  });
  document.querySelectorAll("button[data-view]").forEach(function (button) {
    button.addEventListener("click", function () {
      var view = spec.views[button.dataset.view];
      Plotly.relayout(holder, {
        "scene.camera": copy(view.camera),
        "scene.aspectratio": aspect(view)
      });
    });
  });
  var grid = document.getElementById("grid-switch");
  grid.addEventListener("change", function () {
    var update = {};
    letters.forEach(function (letter) { update["scene." + letter + "axis.visible"] = grid.checked; });
    Plotly.relayout(holder, update);
  });
})();
