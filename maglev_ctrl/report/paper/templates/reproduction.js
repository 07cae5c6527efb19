"use strict";
// Sets the mode shapes in motion: one turn of every vector in two seconds, all in step. Print and readers without
// scripts, or who asked for reduced motion, keep the still drawings.
(() => {
  const box = document.getElementById("moving");
  const moved = [...document.querySelectorAll(".shape .moved")];
  if (!box || !moved.length || !window.requestAnimationFrame) return;
  const modes = moved.map((group) => ({
    group, still: group.getAttribute("transform"), kind: group.dataset.kind, growth: Number(group.dataset.growth),
    motion: group.dataset.motion.split(",").map(Number),
  }));
  const period = 2000, rounds = 4;
  let frame = 0, start = 0;
  const place = (mode, turns) => {
    const phase = 2 * Math.PI * Math.max(0, turns), [zr, zi, tr, ti, yr, yi] = mode.motion;
    let size = 1, c = Math.cos(phase), s = Math.sin(phase);
    const part = (turns % rounds) / rounds;
    if (mode.kind === "flutter") size = Math.exp(2 * Math.PI * rounds * Math.min(mode.growth, 0.1) * (part - 1));
    if (mode.kind === "divergence") { size = Math.exp(3 * (part - 1)); c = 1; s = 0; }
    const at = (re, im) => size * (re * c - im * s);
    const z = at(zr, zi), theta = at(tr, ti) * 180 / Math.PI, y = at(yr, yi);
    mode.group.setAttribute("transform", `translate(${y.toFixed(3)} ${(-z).toFixed(3)}) rotate(${(-theta).toFixed(4)})`);
  };
  const step = (now) => {
    for (const mode of modes) place(mode, (now - start) / period);
    frame = requestAnimationFrame(step);
  };
  const stop = () => {
    cancelAnimationFrame(frame);
    for (const mode of modes) mode.group.setAttribute("transform", mode.still);
  };
  const begin = () => { start = performance.now(); frame = requestAnimationFrame(step); };
  box.disabled = false;
  box.checked = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (box.checked) begin();
  box.addEventListener("change", () => (box.checked ? begin() : stop()));
  window.addEventListener("beforeprint", stop);
  window.addEventListener("afterprint", () => { if (box.checked) begin(); });
})();
