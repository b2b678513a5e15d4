// A command's JSON schema as fields of a form.

/** Units by what a description says, the first that fits. */
const UNITS = [
  [/counts per second/i, "counts/s"], [/frames per second/i, "1/s"], [/\bHz\b/, "Hz"], [/\bdegrees\b/i, "°"],
  [/low-resolution pixels/i, "px"], [/\bmetres\b/i, "m"], [/\bseconds\b/i, "s"], [/\bcounts\b/i, "counts"],
  [/\bMB\b/, "MB"],
];

/** The fields that an action of a command takes: what each may be, in the order of the schema. */
export function fieldsOf(request, action) {
  const models = request?.$defs ?? {};
  const model = Object.values(models).find((found) => found.properties?.action?.const === action);
  return Object.entries(model?.properties ?? {})
    .filter(([name]) => name !== "action")
    .map(([name, property]) => field(name, property, models));
}

/** What `fieldsOf` gives: {name, label, description, unit, kind, words, nullable, bounds of numbers}. */
function field(name, property, models) {
  const resolve = (part) => (part.$ref ? { ...models[part.$ref.split("/").at(-1)], ...part } : part);
  const parts = (property.anyOf ?? [property]).map(resolve);
  const number = parts.find((part) => part.type === "number" || part.type === "integer");
  const words = parts.flatMap((part) => part.enum ?? (part.const === undefined ? [] : [part.const]));
  const description = property.description ?? "";
  const kinds = { boolean: "switch", string: words.length ? "words" : "text" };
  return {
    name, description, words, number,
    label: name.replaceAll("_", " "),
    kind: number ? "number" : kinds[parts[0].type] ?? "text",
    nullable: parts.some((part) => part.type === "null"),
    unit: number ? UNITS.find(([pattern]) => pattern.test(description))?.[1] ?? "" : "",
    bounds: number ? bounds(number) : "",
  };
}

/** The bounds of a number in words, such as `0 < … ≤ 0.1`. */
function bounds({ minimum, exclusiveMinimum, maximum, exclusiveMaximum }) {
  const told = (value) => (Math.abs(value) < 1e5 ? String(value) : value.toExponential().replace("e+", "e"));
  let low = "", high = "";
  if (minimum !== undefined) low = `${told(minimum)} ≤ `;
  else if (exclusiveMinimum !== undefined) low = `${told(exclusiveMinimum)} < `;
  if (maximum !== undefined) high = ` ≤ ${told(maximum)}`;
  else if (exclusiveMaximum !== undefined) high = ` < ${told(exclusiveMaximum)}`;
  return low || high ? `${low}…${high}` : "";
}

/** The value that a text stands for; throws a sentence where it stands for none. */
export function parse(given, text) {
  const word = text.trim();
  if (word === "" && given.nullable) return null;
  if (given.words.includes(word)) return word;
  if (given.kind !== "number") return text;
  const value = Number(word.replace(",", "."));
  if (word !== "" && fits(value, given.number)) return value;
  throw new Error(`${given.label} = ${word || "nothing"}: expected ${expected(given)}`);
}

function expected({ number, bounds: within, words }) {
  const kind = number.type === "integer" ? "a whole number" : "a number";
  return [kind, within && `with ${within}`, words.length && `or ${words.join(", ")}`].filter(Boolean).join(" ");
}

function fits(value, { type, minimum, exclusiveMinimum, maximum, exclusiveMaximum }) {
  return Number.isFinite(value) && (type !== "integer" || Number.isInteger(value))
    && !(value < minimum) && !(value <= exclusiveMinimum) && !(value > maximum) && !(value >= exclusiveMaximum);
}
