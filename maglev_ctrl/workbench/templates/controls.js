// Sliders: a range, a number field with its unit, and words beside them; values are SI outside this file's display.
"use strict"
const Controls = (() => {
  const STEPS = 1000
  const GROUPS = {
    operating: "Operating point", modulation: "Modulation", vehicle: "Vehicle", option: "Suspension option", law: "Control law",
  }
  const MINUS = "\u2212"
  let rows = new Map()
  let gesture = 0
  let newest = {name: "", time: 0}

  const make = (tag, attributes = {}, ...children) => {
    const node = document.createElement(tag)
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value)
    node.append(...children)
    return node
  }
  const slug = (name) => name.replace(/[^A-Za-z0-9_]+/g, "-")
  const shown = (q, value) => {
    const number = value * q.scale
    return (number === 0 ? "0" : String(Number(number.toPrecision(4)))).replace("-", MINUS)
  }
  const words = (q, value) => `${shown(q, value)}${q.unit ? ` ${q.unit}` : ""}`
  const toStep = (q, value) => {
    if (!(q.high > q.low)) return 0
    const share = q.logarithmic ? Math.log(value / q.low) / Math.log(q.high / q.low) : (value - q.low) / (q.high - q.low)
    return Math.round(STEPS * Math.min(1, Math.max(0, share)))
  }
  const fromStep = (q, step) => {
    const share = step / STEPS
    if (share <= 0) return q.low
    if (share >= 1) return q.high
    const value = q.logarithmic ? q.low * (q.high / q.low) ** share : q.low + share * (q.high - q.low)
    return Number(value.toPrecision(6))
  }

  // The gesture an input belongs to: a drag, or keys that follow each other, is one step of undo.
  const gestureOf = (name, fresh, held = false) => {
    const now = performance.now()
    if (fresh || newest.name !== name || (!held && now - newest.time > 900)) gesture += 1
    newest = {name, time: now}
    return `${slug(name)}-${gesture}`
  }

  const read = (q, text) => {
    const typed = text.trim()
    const bare = q.unit && typed.endsWith(q.unit) ? typed.slice(0, -q.unit.length).trim() : typed
    const plain = bare.replace(MINUS, "-").replace(",", ".")
    const number = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(plain) ? Number(plain) : NaN
    const unit = q.unit ? ` ${q.unit}` : ""
    if (!Number.isFinite(number)) return {fault: `Expected a number${q.unit ? ` in ${q.unit}` : ""}, got “${text.trim().slice(0, 30)}”.`}
    const value = number / q.scale
    const near = 1e-9 * Math.max(Math.abs(q.low), Math.abs(q.high))
    if (value < q.low - near || value > q.high + near) {
      return {fault: `Expected ${shown(q, q.low)} to ${shown(q, q.high)}${unit}.`}
    }
    return {value: Math.min(q.high, Math.max(q.low, value))}
  }

  const row = (q, send) => {
    const id = slug(q.name)
    const range = make("input", {type: "range", id: `slide-${id}`, min: 0, max: STEPS, step: 1})
    const field = make("input", {
      type: "text", inputmode: "decimal", id: `field-${id}`, "aria-describedby": `words-${id}`, autocomplete: "off",
      "aria-label": `${q.label}${q.unit ? ` in ${q.unit}` : ""}, typed`,
    })
    const told = make("p", {id: `words-${id}`, class: "words", role: "alert"})
    const label = make("label", {for: `slide-${id}`}, q.label)
    const own = make("span", {class: "own", title: "the scenario’s own value"})
    own.textContent = words(q, q.value)
    const set = (value) => {
      range.value = toStep(q, value)
      range.setAttribute("aria-valuetext", words(q, value))
      field.value = shown(q, value)
      field.removeAttribute("aria-invalid")
      told.textContent = ""
      item.classList.toggle("moved", Math.abs(value - q.value) > 1e-9 * Math.max(1e-12, Math.abs(q.value)))
    }
    let pressed = false, held = false
    range.addEventListener("pointerdown", () => { pressed = held = true })
    for (const end of ["pointerup", "pointercancel", "blur"]) range.addEventListener(end, () => { held = false })
    range.addEventListener("input", () => {
      const value = fromStep(q, Number(range.value))
      set(value)
      send(q.name, value, gestureOf(q.name, pressed, held))
      pressed = false
    })
    field.addEventListener("change", () => {
      const found = read(q, field.value)
      if (found.fault) {
        told.textContent = found.fault
        field.setAttribute("aria-invalid", "true")
        return
      }
      set(found.value)
      send(q.name, found.value, gestureOf(q.name, true))
    })
    const item = make("div", {class: "slider", "data-quantity": q.name},
      label, make("span", {class: "typed"}, field, make("span", {class: "unit"}, q.unit || "")), range,
      make("span", {class: "ends"}, make("span", {}, shown(q, q.low)), own, make("span", {}, shown(q, q.high))), told)
    set(q.value)
    return {q, item, set, busy: () => document.activeElement === field || document.activeElement === range}
  }

  return {
    make, words,
    get gestures() { return gesture },
    // The sliders of a scenario's option, in groups.
    build(host, quantities, send) {
      const focused = document.activeElement?.id
      rows = new Map()
      const groups = new Map()
      for (const q of quantities) {
        const made = row(q, send)
        rows.set(q.name, made)
        if (!groups.has(q.group)) {
          const group = make("fieldset", {id: `group-${q.group}`}, make("legend", {}, GROUPS[q.group] || q.group))
          groups.set(q.group, group)
        }
        groups.get(q.group).append(made.item)
      }
      host.replaceChildren(...groups.values())
      if (focused) document.getElementById(focused)?.focus({preventScroll: true})
    },
    // Values by name; a slider that is not named has the scenario's own.
    show(values, except = "") {
      for (const [name, one] of rows) if (name !== except) one.set(values[name] ?? one.q.value)
    },
    quantity: (name) => rows.get(name)?.q,
  }
})()
