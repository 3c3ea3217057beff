// Card of a block, beside the drawing, of its declarations and what the compiler found. Text is never read as HTML.

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

function link(signal) {
  const at = signal.indexOf(".");
  return element("a", { href: "#", onclick: (event) => { event.preventDefault(); choose(signal.slice(0, at), true); } }, signal);
}

const joined = (words, between) => words.filter(Boolean).join(between);

function withUnit(port) {
  return joined([port.unit === "1" ? "" : port.unit, port.shape && `(${port.shape})`, port.dtype === "float" ? "" : port.dtype], " ");
}

function portRow(port, ends) {
  const wired = element("div", { class: "wired" }, ...ends);
  const about = joined([port.description, port.range], "; ");
  return element("tr", {}, element("th", {}, port.name), element("td", { class: "unit" }, withUnit(port)), element("td", {}, about, wired));
}

function origin(port) {
  if (port.constant !== undefined) return `constant ${port.constant}`;
  return port.default === undefined ? "not wired" : `not wired, so ${port.default}`;
}

function parameterRow(parameter) {
  const other = parameter.own && parameter.default !== "required";
  const live = parameter.live && "may change while running";
  const about = joined([parameter.description, parameter.bounds, other && `default ${parameter.default}`, live], "; ");
  const value = element("td", { class: parameter.own ? "unit own" : "unit" }, parameter.value);
  return element("tr", {}, element("th", {}, parameter.name), value, element("td", {}, about));
}

function prose(paragraphs) {
  const made = paragraphs.map((text) => element(/^\s/m.test(text) ? "pre" : "p", {}, text));
  return element("div", { class: "doc" }, ...(made.length ? made : [element("p", {}, "This block has no docstring.")]));
}

function section(title, ...content) {
  return content.length ? [element("h3", {}, title), ...content] : [];
}

const table = (rows) => (rows.length ? [element("table", {}, ...rows)] : []);

function card(block) {
  const family = families[block.family];
  const inputs = block.inputs.map((port) => portRow(port, port.source ? ["from ", link(port.source)] : [origin(port)]));
  const outputs = block.outputs.map((port) => portRow(port, port.targets.flatMap((target, i) => [i ? ", " : "to ", link(target)])));
  const parameters = block.parameters.map(parameterRow);
  const conditions = block.conditions.map((signal) => `while ${signal}`);
  return [
    element("button", { class: "close", title: "close (Esc)", onclick: () => choose(null) }, "×"),
    element("p", { class: "family", style: `--edge: ${family.edge}; --head: ${family.head}` }, family.title),
    element("h2", {}, block.path),
    element("p", { class: "type" }, block.type, element("span", {}, ` from ${block.module}`)),
    ...block.errors.map((text) => element("p", { class: "error" }, text)),
    ...block.warnings.map((text) => element("p", { class: "warning" }, text)),
    prose(block.documentation),
    ...section("Proof", ...block.proofs.concat(block.bounds.map((command) => `bounds ${command}`)).map((text) => element("p", {}, text))),
    ...section("Inputs", ...table(inputs)), ...section("Outputs", ...table(outputs)), ...section("Parameters", ...table(parameters)),
    element("p", { class: "foot" }, joined([block.runs, block.rate, ...conditions, block.made && `made at ${block.made}`], " · ")),
  ];
}
