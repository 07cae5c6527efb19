// One frame after the other of the picked mode. Every call only wakes the loop; there is one loop per figure.
const CYCLE = 1600 // ms that one oscillation takes on the page, whatever its frequency
const CYCLES = 3 // after which growth or decay starts over
const FRAME = 33 // ms between frames
const KINDS = {1: magnet, 2: spring, 3: actuator}

const state = points.swing ?? (points.swing = {
  turning: false, started: 0, held: 0, last: 0, mode: -1, data: null, parts: [], asked: false, seen: true,
})
if (!state.asked) {
  state.asked = true
  const less = window.matchMedia?.("(prefers-reduced-motion: reduce)")
  if (less?.matches && play.active) play.active = false
  document.addEventListener("visibilitychange", () => wake())
}

// The points of the picked mode, gathered part by part; anew for every mode and every answer of the server.
function gather() {
  const mode = Number(cursor.data.mode[0])
  if (state.mode === mode && state.data === points.data && state.rows === modes.data) return
  state.mode = mode; state.data = points.data; state.rows = modes.data
  const at = points.data
  const parts = []
  let last = -1
  for (let i = 0; i < at.mode.length; i++) {
    if (at.mode[i] !== mode) continue
    if (at.part[i] !== last) { parts.push({kind: at.kind[i], colour: at.colour[i], from: i, to: i}); last = at.part[i] }
    parts[parts.length - 1].to = i + 1
  }
  state.parts = parts
  const own = modes.data
  const known = mode >= 0 && mode < own.left.length
  const here = {sync: false} // what the browser makes of its data is its own: the server need not hear of it
  rail.setv({data: known && Number.isFinite(own.level[mode])
    ? {x: [own.left[mode], own.right[mode]], y: [own.level[mode], own.level[mode]]} : {x: [], y: []}}, here)
  names.setv({data: known ? {x: [...own.names_x[mode]], y: [...own.names_y[mode]], text: [...own.names[mode]]}
    : {x: [], y: [], text: []}}, here)
  const rest = parts.filter((part) => part.kind === 0)
  const around = (part, column) => [...at[column].slice(part.from, part.to), at[column][part.from]]
  still.setv({data: {xs: rest.map((part) => around(part, "x")), ys: rest.map((part) => around(part, "y"))}}, here)
  if (!known) return
  x_range.setv({start: own.left[mode], end: own.right[mode]}, here)
  y_range.setv({start: own.bottom[mode], end: own.top[mode]}, here)
  figure.title.setv({text: own.title[mode]}, here)
  axis.setv({axis_label: own.axis[mode]}, here)
  tell(words, own.words[mode])
}

function draw(time) {
  const mode = state.mode
  const at = points.data
  const own = modes.data
  const turns = time / CYCLE
  const round = turns % CYCLES
  let size = amplitude.value
  if (grow.active && mode >= 0 && mode < own.cycle.length) {
    // Growth begins small and decay begins large, so that neither leaves the window.
    size *= Math.pow(own.cycle[mode], own.cycle[mode] > 1 ? round - CYCLES : round)
  }
  const phase = 2 * Math.PI * turns
  const swinging = mode >= 0 && own.swings[mode] === 1
  const real = size * (swinging || !grow.active ? Math.cos(phase) : 1)
  const imaginary = swinging ? -size * Math.sin(phase) : 0
  const x = (i) => at.x[i] + real * at.x_re[i] + imaginary * at.x_im[i]
  const y = (i) => at.y[i] + real * at.y_re[i] + imaginary * at.y_im[i]
  const faces = {xs: [], ys: [], colour: []}
  const strokes = {1: {x: [], y: []}, 2: {x: [], y: []}, 3: {x: [], y: []}}
  for (const part of state.parts) {
    const across = [], up = []
    for (let i = part.from; i < part.to; i++) { across.push(x(i)); up.push(y(i)) }
    if (part.kind === 0) { faces.xs.push(across); faces.ys.push(up); faces.colour.push(part.colour) }
    else { strokes[part.kind].x.push(...across, NaN); strokes[part.kind].y.push(...up, NaN) }
  }
  boxes.setv({data: faces}, {sync: false})
  for (const [kind, source] of Object.entries(KINDS)) source.setv({data: strokes[kind]}, {sync: false})
}

function turn(now) {
  if (!play.active || document.hidden) { state.turning = false; state.held = now - state.started; return }
  // While a slider is answered the swing waits, and on a slow machine it takes a third of the time at most.
  if (state.drawn) { state.cost = performance.now() - state.drawn; state.drawn = 0 }
  const answering = document.documentElement.dataset.state === "busy"
  if (!answering && now - state.last >= Math.max(FRAME, 3 * Math.min(state.cost ?? 0, 300))) {
    state.last = now
    state.drawn = performance.now()
    draw(now - state.started)
  }
  // Frames nobody draws in cost as well: the next one is asked for when it is due.
  setTimeout(() => requestAnimationFrame(turn), answering ? 2 * FRAME : FRAME / 2)
}

function wake() {
  gather()
  play.setv({label: play.active ? "Pause" : "Play"}, {sync: false})
  if (state.turning) return
  if (!play.active || document.hidden) { draw(state.held); return }
  state.turning = true
  state.started = performance.now() - state.held
  requestAnimationFrame(turn)
}

wake()
