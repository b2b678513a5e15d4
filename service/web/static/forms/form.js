// A form for a command that gets and sets fields, made from its schema.

import { useEffect, useMemo, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { command } from "../link.js";
import { rig, rigLink, useStore } from "../store.js";
import { fieldsOf, parse } from "./schema.js";

/** The form of `cmd/NAME`; only what was changed is sent. */
function Form({ name, title, open }) {
  const known = useStore(rig), link = useStore(rigLink);
  const fields = useMemo(() => fieldsOf(known?.schemas?.[`cmd/${name}`]?.request, "set"), [known]);
  const [inForce, setInForce] = useState(null), [edits, setEdits] = useState({}), [said, setSaid] = useState(null);
  const failed = (error) => setSaid({ text: error.message, kind: "bad" });
  const load = () => command(`cmd/${name}`, "get").then((reply) => setInForce(reply[name]), failed);
  useEffect(() => {
    if (known) load();
  }, [known]);
  const apply = async (event) => {
    event.preventDefault();
    try {
      const changed = Object.entries(edits).map(([key, text]) => [key, value(fields.find((f) => f.name === key), text)]);
      setSaid({ text: "It is put in force, after the burst at work…", kind: "" });
      const reply = await command(`cmd/${name}`, "set", Object.fromEntries(changed), 300);
      setInForce(reply[name]);
      setEdits({});
      setSaid({ text: "In force.", kind: "good" });
    } catch (error) {
      failed(error);
    }
  };
  const count = Object.keys(edits).length;
  const edit = (key, text) => setEdits((before) => without(before, key, text, inForce));
  return html`<details class="form" open=${open}>
    <summary>${title}${count > 0 && html`<small>${count} changed</small>`}</summary>
    <form onSubmit=${apply} id=${`form-${name}`} novalidate>
      ${inForce && fields.map((given) => html`<${Field} key=${given.name} form=${name} given=${given}
        current=${inForce[given.name]} edit=${edits[given.name]} onEdit=${(text) => edit(given.name, text)} />`)}
      <div class="form-foot"><button type="submit" class="primary" disabled=${count === 0 || !link.up}>Apply</button>
        <button type="button" disabled=${count === 0} onClick=${() => setEdits({})}>Revert</button>
        <button type="button" disabled=${!link.up} onClick=${load}>Reload</button></div>
      <p class=${`said ${said?.kind ?? ""}`} role="status">${said?.text ?? ""}</p>
    </form></details>`;
}

const value = (given, text) => (given.kind === "switch" ? text : parse(given, text));

/** The edits with one more; without it where it is what is in force. */
function without(edits, key, text, inForce) {
  const { [key]: _, ...others } = edits;
  return text === shown(inForce[key]) ? others : { ...others, [key]: text };
}

const shown = (current) => (typeof current === "boolean" ? current : current === null ? "" : String(current));

function Field({ form, given, current, edit, onEdit }) {
  const id = `${form}-${given.name}`, text = edit ?? shown(current);
  const description = given.description.replaceAll("`", "");
  const bounds = given.bounds && `${given.bounds} ${given.unit}`;
  return html`<div class=${`field ${edit === undefined ? "" : "changed"}`}>
    <label for=${id}>${given.label}</label>
    <div class="control"><${Control} id=${id} given=${given} text=${text} onEdit=${onEdit} />
      <span class="unit">${given.unit}</span></div>
    <p class="hint" id=${`${id}-hint`}>${description} ${bounds && html`<span class="bounds">${bounds}</span>`}</p></div>`;
}

function Control({ id, given, text, onEdit }) {
  const common = { id, name: given.name, "aria-describedby": `${id}-hint` };
  if (given.kind === "switch") {
    const change = (event) => onEdit(event.target.checked);
    return html`<input ...${common} type="checkbox" checked=${text} onChange=${change} />`;
  }
  if (given.kind === "words") {
    return html`<select ...${common} value=${text} onChange=${(event) => onEdit(event.target.value)}>
      ${given.nullable && html`<option value="">none</option>`}
      ${given.words.map((word) => html`<option value=${word}>${word}</option>`)}</select>`;
  }
  const list = given.words.length ? `${id}-words` : undefined;
  return html`<input ...${common} type="text" inputmode=${list ? undefined : "decimal"} autocomplete="off"
      value=${text} list=${list} placeholder=${given.nullable ? "none" : ""} onInput=${(event) => onEdit(event.target.value)} />
    ${list && html`<datalist id=${list}>
      ${given.words.map((word) => html`<option value=${word}></option>`)}</datalist>`}`;
}

export function Settings() {
  return html`<div class="forms"><${Form} name="settings" title="Camera" open=${true} />
    <${Form} name="plan" title="Plan" open=${false} /><${Form} name="fusion" title="Fusion" open=${false} /></div>`;
}
