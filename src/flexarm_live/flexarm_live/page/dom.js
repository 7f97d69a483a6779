// Elements of the page: made, found and filled, without markup in strings.

const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

/** Give an element attributes (`on...` are listeners, booleans are properties) and children. */
function furnish(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (typeof value === "boolean" && name in node) node[name] = value;
    else node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
}

export const element = (tag, attributes = {}, ...children) =>
  furnish(document.createElement(tag), attributes, children);

export const drawn = (tag, attributes = {}, ...children) =>
  furnish(document.createElementNS(SVG, tag), attributes, children);

/** Fill a menu with `[value, text]` pairs and keep the choice where it is still there. */
export function fillMenu(menu, pairs, chosen = menu.value) {
  menu.replaceChildren(...pairs.map(([value, text]) => element("option", { value }, text)));
  if (pairs.some(([value]) => value === chosen)) menu.value = chosen;
}

/** Rows of a table body; a cell is text or an element, and the first one heads its row. */
export function fillTable(body, rows) {
  body.replaceChildren(
    ...rows.map(([head, ...cells]) =>
      element(
        "tr",
        {},
        element("th", { scope: "row" }, head),
        ...cells.map((cell) => element("td", {}, cell)),
      ),
    ),
  );
}

/** Write a text only where it differs: a reader of the screen is told of changes alone. */
export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Buttons of which any may be pressed; `changed` hears of each press. */
export class Toggles {
  #chosen;

  constructor(host, changed, chosen = []) {
    Object.assign(this, { host, changed });
    this.#chosen = new Set(chosen);
  }

  get chosen() {
    return [...this.#chosen];
  }

  /** Show a button for each name; of those that were pressed, the ones still there stay so. */
  offer(names, chosen = this.chosen) {
    this.#chosen = new Set(chosen.filter((name) => names.includes(name)));
    this.host.replaceChildren(...names.map((name) => this.#button(name)));
  }

  #button(name) {
    const button = element("button", { "aria-pressed": `${this.#chosen.has(name)}` }, name);
    button.onclick = () => {
      if (!this.#chosen.delete(name)) this.#chosen.add(name);
      button.setAttribute("aria-pressed", `${this.#chosen.has(name)}`);
      this.changed();
    };
    return button;
  }
}

let fadeOut = 0;

/** Tell the user a line; a refusal stays until the next one, news go away. */
export function announce(text, refused = false) {
  const line = byId("message");
  clearTimeout(fadeOut);
  line.classList.toggle("refused", refused);
  write(line, text);
  if (!refused) fadeOut = setTimeout(() => write(line, ""), 4000);
}

/** Run what a control asks for; a refusal becomes a line for the user, and `undone` follows. */
export async function attempt(work, undone = () => {}) {
  try {
    return await work();
  } catch (refusal) {
    announce(refusal.message, true);
    undone();
    return undefined;
  }
}
