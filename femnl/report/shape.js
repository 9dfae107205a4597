// Draw the shape of the chosen mode. Without WebGL the picture stays, and in print it stands in for the scene.
(() => {
  const canvas = document.createElement("canvas");
  if (!canvas.getContext("webgl2") && !canvas.getContext("webgl")) return;
  const { film, edge, scene, shapes } = JSON.parse(document.getElementById("shape-data").textContent);
  const place = document.getElementById("shape-scene");
  const choice = document.getElementById("shape-mode");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const style = () => {
    const axis = { gridcolor: colour("--line"), zerolinecolor: colour("--line"), linecolor: colour("--line"), showbackground: false };
    return {
      paper_bgcolor: "rgba(0,0,0,0)",
      font: { color: colour("--ink"), family: getComputedStyle(document.body).fontFamily },
      margin: { l: 0, r: 0, t: 0, b: 0 },
      scene: { ...scene, xaxis: { ...scene.xaxis, ...axis }, yaxis: { ...scene.yaxis, ...axis }, zaxis: { ...scene.zaxis, ...axis } },
      showlegend: false,
      uirevision: "kept",
    };
  };
  const draw = () => {
    const heights = shapes[choice.value];
    const line = { ...edge, line: { color: colour("--soft"), width: 2 } };
    return Plotly.react(place, [{ ...film, z: heights, intensity: heights }, line], style(), {
      displaylogo: false,
      responsive: true,
      scrollZoom: false,
      modeBarButtonsToRemove: ["toImage", "tableRotation", "resetCameraLastSave3d", "hoverClosest3d"],
    });
  };
  document.getElementById("shape").classList.add("turning");
  choice.addEventListener("change", draw);
  dark.addEventListener("change", draw);
  draw();
})();
