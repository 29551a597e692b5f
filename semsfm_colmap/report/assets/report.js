(function () {
  "use strict";
  var holder = document.getElementById("scene");
  if (!holder) { return; }
  var spec = JSON.parse(document.getElementById("scene-data").textContent);
  var config = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["tableRotation"] };
  Plotly.newPlot(holder, spec.data, spec.layout, config);
  document.querySelectorAll("input[data-switch]").forEach(function (box) {
    box.addEventListener("change", function () {
      var traces = spec.switches[Number(box.dataset.switch)].traces;
      Plotly.restyle(holder, { visible: box.checked }, traces);
    });
  });
  document.querySelectorAll("button[data-view]").forEach(function (button) {
    button.addEventListener("click", function () {
      var camera = JSON.parse(JSON.stringify(spec.views[button.dataset.view]));
      Plotly.relayout(holder, { "scene.camera": camera, "scene.aspectmode": "data" });
    });
  });
})();
