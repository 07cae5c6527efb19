// The scenario's text: checked while it is written, applied when asked for; faults in words, with a way to their line.
"use strict"
const Editor = (() => {
  const at = (id) => document.getElementById(id)
  let shownText = ""
  let send = () => {}
  let timer = 0
  let count = 0

  const changed = () => at("scenario-text").value !== shownText
  const buttons = () => {
    at("apply-text").disabled = at("revert-text").disabled = !changed()
  }
  const place = () => {
    const area = at("scenario-text")
    const before = area.value.slice(0, area.selectionStart)
    const line = before.split("\n").length
    at("text-place").textContent = `Line ${line}, column ${before.length - before.lastIndexOf("\n")}`
  }
  const jump = (line, column) => {
    const area = at("scenario-text")
    const lines = area.value.split("\n")
    const start = lines.slice(0, line - 1).reduce((sum, one) => sum + one.length + 1, 0)
    const end = start + (lines[line - 1]?.length ?? 0)
    at("editor").open = true
    area.focus()
    area.setSelectionRange(Math.min(start + column - 1, end), end)
    const height = parseFloat(getComputedStyle(area).lineHeight) || 18
    area.scrollTop = Math.max(0, (line - 5) * height)
    area.scrollLeft = 0
    place()
  }
  const check = () => {
    clearTimeout(timer)
    timer = setTimeout(() => {
      count += 1
      if (new Blob([at("scenario-text").value]).size > Editor.limit) {
        at("text-words").textContent = "The text is longer than 1 MiB; shorten it."
        return
      }
      at("text-words").textContent = "Checking ..."
      send({kind: "check", text: at("scenario-text").value, count})
    }, 500)
  }

  return {
    limit: 2 ** 20,
    start(sender) {
      send = sender
      const area = at("scenario-text")
      area.addEventListener("input", () => { buttons(); place(); check(); Editor.keep() })
      area.addEventListener("keyup", place)
      area.addEventListener("click", place)
      area.addEventListener("keydown", (event) => {
        if (event.key === "Enter" && (event.ctrlKey || event.metaKey) && changed()) at("apply-text").click()
      })
      at("apply-text").addEventListener("click", () => {
        if (new Blob([area.value]).size > Editor.limit) return
        const text = area.value
        shownText = text
        buttons()
        Editor.keep()
        send({kind: "edit", text})
      })
      at("revert-text").addEventListener("click", () => {
        area.value = shownText
        buttons()
        Editor.keep()
        check()
      })
    },
    // A text that is being written survives a lost connection.
    keep() {
      try {
        if (changed()) sessionStorage.setItem("maglev-ctrl-draft", at("scenario-text").value)
        else sessionStorage.removeItem("maglev-ctrl-draft")
      } catch { /* a browser that keeps nothing */ }
    },
    restore() {
      let draft = null
      try { draft = sessionStorage.getItem("maglev-ctrl-draft") } catch { /* a browser that keeps nothing */ }
      if (draft === null || draft === shownText) return
      at("scenario-text").value = draft
      at("editor").open = true
      buttons()
      check()
    },
    // A new text from the server; one that is being written here is left alone.
    show(text, force) {
      const area = at("scenario-text")
      if (!force && changed()) { shownText = text; buttons(); return }
      shownText = text
      const [top, start, end] = [area.scrollTop, area.selectionStart, area.selectionEnd]
      area.value = text
      area.setSelectionRange(Math.min(start, text.length), Math.min(end, text.length))
      area.scrollTop = top
      buttons()
    },
    problems(listed, answered) {
      if (answered && answered !== count) return
      const list = at("problems")
      list.replaceChildren(...listed.slice(0, 100).map((one) => {
        const item = Controls.make("li")
        if (one.line && !one.file) {
          const button = Controls.make("button", {type: "button", class: "jump", "data-line": one.line, "data-column": one.column})
          button.textContent = `Line ${one.line}, column ${one.column}`
          button.addEventListener("click", () => jump(one.line, one.column))
          item.append(button, " ")
        } else if (one.file) {
          item.append(`${one.file}${one.line ? `, line ${one.line}, column ${one.column}` : ""}: `)
        }
        if (one.key) { const key = Controls.make("code"); key.textContent = one.key; item.append(key, ": ") }
        item.append(one.words)
        return item
      }))
      const more = listed.length > 100 ? ` The first 100 are shown.` : ""
      at("text-words").textContent = listed.length
        ? `${listed.length} fault${listed.length === 1 ? "" : "s"}.${more}` : changed() ? "None; not applied yet." : "None."
      at("scenario-text").setAttribute("aria-invalid", listed.length ? "true" : "false")
    },
    open() { at("editor").open = true },
  }
})()
