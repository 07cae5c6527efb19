// Light or dark before anything is drawn: as chosen here before, else as the system has it.
"use strict"
{
  let chosen = null
  try { chosen = localStorage.getItem("maglev-ctrl-theme") } catch { /* a browser that keeps nothing */ }
  const dark = chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches
  document.documentElement.dataset.theme = dark ? "dark" : "light"
}
