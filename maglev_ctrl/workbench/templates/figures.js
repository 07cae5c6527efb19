// What Bokeh's figures leave out on this page, because it costs a third of every paint and does nothing here.
"use strict"
const Figures = {
  // Bokeh looks into the style sheets for the colour of every stroke, and writes the place of every part of a figure
  // into one on each paint, so that styles are laid out anew some sixty times per move. No figure here is coloured by
  // style sheets (see style.py), and a place that stays needs no writing. Without these parts of Bokeh it is only slower.
  quicken() {
    try {
      const visual = Bokeh.require("core/visuals/visual").VisualProperties.prototype
      const sheet = Bokeh.require("core/dom").InlineStyleSheet.prototype
      if (typeof visual._get_css_value !== "function" || typeof sheet._update !== "function") return
      const update = sheet._update
      visual._get_css_value = () => ""
      sheet._update = function (css) { if (this.el.textContent !== css) update.call(this, css) }
    } catch { /* another version of Bokeh */ }
  },
}
