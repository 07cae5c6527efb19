// The page: connects to its document on the server, shows what it is told, says what is done here.
"use strict"
{
  const at = (id) => document.getElementById(id)
  const root = document.documentElement
  const FILES = {"report.html": "Report (HTML)", "report.pdf": "PDF", "report.json": "JSON", "tuned.toml": "Tuned scenario"}
  let live = null       // the document shared with the server
  let bridge = null
  let key = ""
  let limit = 2 ** 20
  let count = 0
  let asked = 0         // serial of the last wish to see something else
  let rested = "starting"
  let values = {}
  let lost = false
  let busyWords = ""
  let opened = false
  let textShown = null
  let uploaded = ""     // name of the file whose answer is waited for

  const storage = (kind, name, value) => {
    try {
      if (value === undefined) return kind.getItem(name)
      kind.setItem(name, value)
    } catch { /* a browser that keeps nothing */ }
    return null
  }
  // After these the page is busy until what it shows answers the newest of them.
  const ASKING = new Set(["choose", "option", "upload", "edit", "values", "undo", "redo", "reset", "design"])
  const say = (event) => {
    if (!bridge || lost) return
    count += 1
    if (ASKING.has(event.kind)) { asked = count; state("busy") }
    bridge.inbox = JSON.stringify({...event, serial: count})
  }
  const state = (name) => {
    if (name !== "busy") rested = name
    root.dataset.state = lost ? "lost" : name
  }
  const message = (words) => {
    at("message-strip").hidden = !words
    at("message").textContent = words
  }

  // Sliders: only the newest values go out, and one wish at a time is on its way.
  let waiting = null    // {values, gesture, time}
  let underway = null   // {time, sent}
  const flush = () => {
    if (!waiting || (underway && performance.now() - underway.sent < 600)) return
    const wish = waiting
    waiting = null
    underway = {time: wish.time, sent: performance.now()}
    say({kind: "values", values: wish.values, gesture: wish.gesture})
  }
  setInterval(flush, 200)
  const moved = (name, value, gesture) => {
    values[name] = value
    if (name === "speed" || name === "depth") place({[name]: value})
    if (waiting && waiting.gesture !== gesture) {
      say({kind: "values", values: waiting.values, gesture: waiting.gesture})
      waiting = null
    }
    waiting = {values: {...waiting?.values, [name]: value}, gesture, time: waiting?.time ?? performance.now()}
    state("busy")
    flush()
  }
  // Markers along the tracks and the cursor on the map move here, before the server hears of it.
  const place = (changes) => {
    const cursor = live?.get_model_by_name("cursor")
    if (!cursor) return
    const next = {...cursor.data}
    let other = false
    for (const [name, value] of Object.entries(changes)) {
      other ||= Number(next[name]?.[0]) !== value
      next[name] = [value]
    }
    if (other) cursor.data = next
  }

  // A tap on the map, or a drag, moves the sliders: one gesture, one step of undo.
  let points = 0
  const pointed = (event) => {
    if (event.detail.begins) points += 1
    for (const name of ["speed", "depth"]) {
      const q = Controls.quantity(name)
      if (!q) continue
      const value = Number(Math.min(q.high, Math.max(q.low, event.detail[name])).toPrecision(6))
      if (value !== (values[name] ?? q.value)) moved(name, value, `map-${points}`)
    }
    Controls.show(values)
  }

  // The address follows when the figures are drawn: it costs more than all other words of a move.
  let address = null, kept = null
  const putAddress = () => {
    if (address !== null) history.replaceState(null, "", location.pathname + address)
    address = null
  }

  const tell = {
    hello(event) { key = event.key; limit = Editor.limit = event.limit },
    sources(event) {
      const groups = new Map()
      for (const one of event.listed) {
        if (!groups.has(one.group)) groups.set(one.group, Controls.make("optgroup", {label: one.group}))
        const option = Controls.make("option", {value: one.key})
        option.textContent = one.label
        groups.get(one.group).append(option)
      }
      at("source").replaceChildren(...groups.values())
      at("source-words").textContent = event.words
      at("source-words").hidden = !event.words
    },
    empty(event) {
      at("title").textContent = "No scenario"
      verdict("unknown", "?", "", event.words)
      state("failed")
    },
    state(event) {
      const select = at("source")
      select.querySelector("option[data-own]")?.remove()
      if (!event.source || event.edited) {
        const own = Controls.make("option", {value: "", "data-own": ""})
        own.textContent = event.source ? `${event.name} (edited)` : `${event.name} (yours)`
        select.prepend(own)
        select.value = ""
      } else select.value = event.source
      values = event.values
      at("undo").disabled = !event.undo
      at("redo").disabled = !event.redo
      at("copy-link").disabled = event.address === "#kept"
      at("copy-link").title = event.address === "#kept" ? "This scenario is too long for an address; download it instead" : ""
      if (event.kept !== kept) storage(sessionStorage, "maglev-ctrl-kept", kept = event.kept)
      address = event.address
      setTimeout(putAddress, 400)
      if (event.text !== undefined && event.text !== textShown) {
        textShown = event.text
        Editor.show(event.text, opened)
        Editor.problems([], 0)
      }
      if (!waiting && !underway) Controls.show(values)
      downloads()
      state("busy")
    },
    opened(event) {
      uploaded = ""
      if (event.fresh) { delete root.dataset.compared; at("view-comparison").classList.remove("following") }
      at("title").textContent = event.title
      document.title = `${event.title} – maglev-ctrl workbench`
      const select = at("option")
      select.replaceChildren(...event.options.map((one) => {
        const option = Controls.make("option", {value: one.name})
        option.textContent = one.label
        return option
      }))
      select.value = event.option
      select.disabled = false
      Controls.build(at("sliders"), event.quantities, moved)
      Controls.show(values)
      at("make-report").disabled = at("reset-values").disabled = false
      if (!opened) { opened = true; Editor.restore() }
    },
    busy(event) {
      busyWords = event.words
      at("verdict").classList.toggle("busy", !!event.words)
      document.querySelector(".views").classList.toggle("following", !!event.words)
      if (event.words) { at("verdict-words").textContent = event.words; state("busy") }
    },
    view(event) {
      verdict(event.failure ? "fail" : event.settled ? event.slug : "unknown", event.failure ? "!" : event.settled ? event.sign : "…",
        event.failure ? "Nothing to show" : event.settled ? event.verdict : "NOT CHECKED YET", event.words)
      at("notes").replaceChildren(...event.notes.map((words) => { const item = Controls.make("li"); item.textContent = words; return item }))
      at("design").hidden = !event.away
      at("design-words").textContent = event.away
      for (const part of document.querySelectorAll(".view")) part.classList.toggle("unsettled", !event.settled)
      at("view-map").classList.toggle("following", event.following)
      if (!event.settled && root.dataset.compared) at("view-comparison").classList.add("following")
      const began = underway?.time
      if (!event.settled) underway = null
      const server = `${Math.round(1000 * event.seconds)} ms`
      requestAnimationFrame(() => requestAnimationFrame(() => {
        putAddress()
        root.dataset.shown = Number(root.dataset.shown) + 1
        root.dataset.seconds = event.seconds
        if (event.answers >= asked && !waiting) state(event.failure ? "failed" : event.settled ? "settled" : "preview")
        if (event.settled) { at("timing").textContent = `Checked in ${server}.`; return }
        if (began !== undefined) root.dataset.latency = Math.round(performance.now() - began)
        at("timing").textContent = `Computed in ${server}` + (began === undefined ? "." : `, on screen after ${root.dataset.latency} ms.`)
      }))
      flush()
    },
    compared() { at("view-comparison").classList.remove("following"); if (!root.dataset.compared) dress()
      root.dataset.compared = Number(root.dataset.compared || 0) + 1 },
    written(event) { textShown = event.text; Editor.show(event.text, false) },
    refused(event) {
      underway = null
      if (uploaded) at("upload-words").textContent = `${uploaded}: ${event.words}`
      uploaded = ""
      verdict("fail", "!", "Nothing to show", event.words)
      at("design").hidden = true
      at("notes").replaceChildren()
      if (event.open) Editor.open()
      if (!opened) { at("title").textContent = "No scenario"; opened = true }
      state("failed")
      flush()
    },
    problems(event) { Editor.problems(event.listed, event.count) },
    message(event) {
      message(event.words)
      underway = null
      if (root.dataset.state === "busy" && rested !== "starting") state(rested)  // nothing came of the wish
      flush()
    },
    job(event) {
      const running = event.status === "running"
      at("report-running").hidden = !running
      at("make-report").disabled = running || !opened
      const left = event.left === null ? "" : event.left < 90 ? `, about ${event.left} s left` : `, about ${Math.round(event.left / 60)} min left`
      const percent = `${Math.round(100 * event.fraction)} %`
      at("report-words").textContent = {
        none: "The report studies every option against every requirement, with the sliders’ values; it takes a minute or more.",
        running: `Making the report: ${event.words} (${percent}${left})`,
        done: `The report is ready (${event.words}).`,
        failed: `No report: ${event.words}`,
        cancelled: `The report was ${event.words}.`,
      }[event.status]
      at("report-words").className = event.status
      at("report-progress").value = event.fraction
      const links = event.files.map((name) => {
        const link = Controls.make("a", {href: `/reports/${event.folder}/${name}`, target: "_blank", rel: "noopener", class: "button"})
        link.textContent = FILES[name] || name
        return link
      })
      at("report-links").replaceChildren(...(running ? [] : links))
    },
  }

  const verdict = (slug, sign, name, words) => {
    at("verdict").className = `banner ${slug}`
    at("verdict-sign").textContent = `${sign} ${name}`.trim()
    at("verdict-words").textContent = busyWords || words
  }
  let linked = ""
  const downloads = () => {
    if (linked === key) return
    linked = key
    for (const link of document.querySelectorAll(".downloads a")) {
      link.href = `/files/${key}/${link.dataset.view}.${link.dataset.kind}`
      link.setAttribute("download", "")
    }
    at("download-scenario").href = `/files/${key}/scenario.toml`
    at("download-scenario").hidden = false
  }
  // A download that cannot be made answers in words instead of a file.
  const download = async (link) => {
    message("")
    link.classList.add("waiting")
    try {
      const answer = await fetch(link.href)
      if (!answer.ok) { message(`The download is not there: ${(await answer.text()).trim()}`); return }
      const name = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition") || "")?.[1] || "download"
      const made = Controls.make("a", {href: URL.createObjectURL(await answer.blob()), download: name})
      document.body.append(made)
      made.click()
      made.remove()
      setTimeout(() => URL.revokeObjectURL(made.href), 10000)
    } catch {
      message("The download is not there: the workbench does not answer.")
    } finally {
      link.classList.remove("waiting")
    }
  }

  const upload = async (input) => {
    const file = input.files[0]
    const told = at("upload-words")
    told.textContent = ""
    if (!file) return
    try {
      if (file.size > limit) throw new Error(`${file.name} has ${(file.size / 2 ** 20).toFixed(1)} MiB; expected at most 1 MiB.`)
      const bytes = await file.arrayBuffer()
      let text
      try { text = new TextDecoder("utf-8", {fatal: true}).decode(bytes) } catch { throw new Error(`${file.name}: expected UTF-8 text.`) }
      uploaded = file.name
      say({kind: "upload", name: file.name, text})
    } catch (fault) {
      told.textContent = fault.message
    } finally {
      input.value = ""
    }
  }

  const dress = () => {
    const dark = root.dataset.theme === "dark"
    at("theme").textContent = dark ? "Light" : "Dark"
    at("theme").setAttribute("aria-label", dark ? "Use light colours" : "Use dark colours")
    live?.get_model_by_name("theme-switch")?.execute({active: dark})
  }

  const begin = () => {
    Editor.start(say)
    at("source").addEventListener("change", (event) => { if (event.target.value) say({kind: "choose", key: event.target.value}) })
    at("option").addEventListener("change", (event) => say({kind: "option", name: event.target.value}))
    at("upload").addEventListener("change", (event) => upload(event.target))
    for (const [id, kind] of Object.entries({
      undo: "undo", redo: "redo", "reset-values": "reset", "make-design-point": "design", "make-report": "report", "cancel-report": "cancel",
    })) at(id).addEventListener("click", () => { message(""); say({kind}) })
    at("make-report").addEventListener("click", () => at("report").scrollIntoView({block: "nearest"}))
    at("message-close").addEventListener("click", () => message(""))
    at("theme").addEventListener("click", () => {
      root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark"
      storage(localStorage, "maglev-ctrl-theme", root.dataset.theme)
      dress()
    })
    at("copy-link").addEventListener("click", async () => {
      let done = true
      putAddress()
      try { await navigator.clipboard.writeText(location.href) } catch { done = false }
      at("copy-link").textContent = done ? "Copied" : "See address bar"
      setTimeout(() => { at("copy-link").textContent = "Copy link" }, 1500)
    })
    addEventListener("keydown", (event) => {
      const typing = event.target.closest?.("textarea, input[type=text]")
      if (!(event.ctrlKey || event.metaKey) || typing) return
      const pressed = event.key.toLowerCase()
      if (pressed === "z" || pressed === "y") {
        event.preventDefault()
        at(pressed === "y" || event.shiftKey ? "redo" : "undo").click()
      }
    })
    document.addEventListener("maglev-ctrl-point", pointed)
    addEventListener("pagehide", putAddress)
    addEventListener("hashchange", () => location.reload())
    document.addEventListener("click", (event) => {
      const link = event.target.closest?.(".downloads a, #download-scenario")
      if (!link) return
      event.preventDefault()
      download(link)
      if (link.id === "download-scenario" && !at("design").hidden) {
        message("The downloaded file has its design point where you look now: magnets and control law are designed there anew.")
      }
    })
  }

  const gone = () => {
    if (lost) return
    lost = true
    root.dataset.state = "lost"
    at("connection").textContent = "The connection to the workbench is lost; trying again. What you set is kept, and a report goes on."
    at("connection").hidden = false
    const again = async () => {
      try {
        const answer = await fetch("/alive", {cache: "no-store", signal: AbortSignal.timeout(2000)})
        if (answer.ok) { location.reload(); return }
      } catch { /* not there yet */ }
      setTimeout(again, 1000)
    }
    setTimeout(again, 500)
  }

  const connect = async () => {
    const item = JSON.parse(document.body.dataset.item)
    begin()
    dress()
    Bokeh.set_log_level?.("warn")
    Figures.quicken()
    try {
      await Bokeh.embed.embed_items({}, [item], document.body.dataset.live)
    } catch (fault) {
      console.error(fault)
      gone()
      return
    }
    live = Bokeh.documents.find((one) => one.get_model_by_name("bridge"))
    bridge = live.get_model_by_name("bridge")
    live.on_event("connection_lost", gone)
    bridge.properties.outbox.change.connect(() => {
      const event = JSON.parse(bridge.outbox)
      tell[event.kind]?.(event)
    })
    dress()
    say({kind: "hello", search: location.search, hash: location.hash, kept: storage(sessionStorage, "maglev-ctrl-kept")})
  }
  addEventListener("DOMContentLoaded", connect)
}
