"use strict";
// Unpacks the figure library and the figures' data kept in this very file, and draws a figure when it comes into view.
// Whatever fails, the still figures stay.
const LETTERS = [];
[..."0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;,=>?@^_`{|}~"].forEach((letter, k) => { LETTERS[letter.charCodeAt(0)] = k; });
const theme = document.getElementById("theme"), scheme = matchMedia("(prefers-color-scheme: dark)");
const dark = () => (document.documentElement.dataset.theme ?? (scheme.matches ? "dark" : "light")) === "dark";
const named = () => { if (theme) theme.textContent = dark() ? "Light page" : "Dark page"; };
if (theme) {
  theme.hidden = false;
  theme.addEventListener("click", () => {
    document.documentElement.dataset.theme = dark() ? "light" : "dark";
    scheme.dispatchEvent(new Event("change"));
  });
}
scheme.addEventListener("change", named);
named();
(async () => {
  const live = document.getElementById("live");
  const charts = [...document.querySelectorAll("figure[data-chart]")];
  if (!("DecompressionStream" in window) || !charts.length) return;
  const unpack = async (id) => {
    const text = document.getElementById(id).textContent.trim();
    const bytes = new Uint8Array(5 + (text.length * 4) / 5);
    let size = 0;
    for (let i = 0; i < text.length; i += 5) {  // five letters are four bytes; a shorter end is filled up and cut
      let value = 0;
      for (let k = 0; k < 5; k++) value = value * 85 + (i + k < text.length ? LETTERS[text.charCodeAt(i + k)] : 84);
      for (let shift = 3; shift >= 0; shift--) bytes[size + shift] = value % 256, value = Math.floor(value / 256);
      size += Math.min(5, text.length - i) - 1;
    }
    const stream = new Blob([bytes.subarray(0, size)]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  let figures;
  try {
    figures = JSON.parse(await unpack("figure-data"));
    const code = document.createElement("script");
    code.textContent = await unpack("figure-library");
    document.head.append(code);
    if (!window.Plotly) return;
  } catch { return; }
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const words = (figure) => figure.querySelector("svg")?.getAttribute("aria-label") ?? "";
  const dressed = (spec) => {
    const ink = colour("--ink"), grid = colour("--grid"), paper = colour("--paper");
    const text = JSON.stringify(spec).replaceAll('"#1b1b1b"', JSON.stringify(ink)).replaceAll('"paper-colour"', JSON.stringify(paper));
    const { data, layout } = JSON.parse(text);
    layout.font = { ...layout.font, color: ink, family: getComputedStyle(document.body).fontFamily };
    for (const [key, axis] of Object.entries(layout)) {
      if (/^[xy]axis/.test(key)) Object.assign(axis, { gridcolor: grid, linecolor: ink, showline: true, tickcolor: ink, ticks: axis.showticklabels ? "outside" : "" });
    }
    return { data, layout };
  };
  // On a narrow page the legend stands below, so that the panels keep the width.
  const narrowed = (data, layout, width) => {
    if (width > 620) return;
    const rows = data.filter((trace) => trace.showlegend !== false).length;
    layout.legend = { ...layout.legend, orientation: "h", x: 0, xanchor: "left", y: -60 / layout.height, yanchor: "top", font: { size: 10 } };
    layout.height += 20 * rows;
    layout.margin = { ...layout.margin, l: 50, r: 8 };
    for (const [key, axis] of Object.entries(layout)) if (/^[xy]axis/.test(key) && axis.title) axis.title.font = { size: 9 };
    for (const note of layout.annotations ?? []) note.font = { ...note.font, size: Math.min(note.font?.size ?? 10, 9) };
  };
  const show = async (figure) => {
    const target = figure.querySelector(".dynamic"), still = figure.querySelector(".static");
    if (!live.checked) return;
    target.hidden = false;
    try {
      const { data, layout } = dressed(figures[figure.dataset.chart]);
      layout.width = undefined;
      narrowed(data, layout, target.clientWidth);
      await window.Plotly.react(target, data, layout, { responsive: true, displaylogo: false, modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]] });
      target.setAttribute("role", "group");
      target.setAttribute("aria-label", words(figure));
      still.style.display = "none";
      figure.dataset.drawn = "yes";
    } catch { target.hidden = true; still.style.display = ""; }
  };
  const hide = (figure) => {
    figure.querySelector(".dynamic").hidden = true;
    figure.querySelector(".static").style.display = "";
    delete figure.dataset.drawn;
  };
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting && !entry.target.dataset.drawn) show(entry.target);
  }, { rootMargin: "400px" });
  live.disabled = false;
  live.addEventListener("change", () => {
    seen.disconnect();
    charts.forEach((figure) => (live.checked ? seen.observe(figure) : hide(figure)));
  });
  scheme.addEventListener("change", () =>
    charts.filter((figure) => figure.dataset.drawn).forEach(show));
  charts.forEach((figure) => seen.observe(figure));
})();
