// A figure has a head with controls and its data as CSV, a chart or a sentence in its place, and a caption.

const blue = "#0072b2", orange = "#d55e00", green = "#009e73", purple = "#cc79a7", ink = "#222", soft = "#5a5f66", faint = "#e3e6ea";
const chartOptions = {
  displaylogo: false,
  responsive: true,
  modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "hoverClosestCartesian", "hoverCompareCartesian", "toggleSpikelines"]
};
const pending = [];  // charts under way

function element(tag, text = "", attributes = {}) {
  const e = document.createElement(tag);
  e.textContent = text;
  Object.assign(e, attributes);
  return e;
}

function chartLayout(changes) {
  return Object.assign(
      {
        autosize: true,
        paper_bgcolor: "#fff",
        plot_bgcolor: "#fff",
        hovermode: "closest",
        font: {family: "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif", size: 13, color: ink},
        margin: {l: 72, r: 24, t: 34, b: 56},
        legend: {orientation: "h", x: 0, y: -0.16, xanchor: "left", yanchor: "top"},
        hoverlabel: {bgcolor: "#fff", bordercolor: "#999", font: {color: ink, size: 13}, align: "left"},
      },
      changes);
}

const colourBar = (title, changes = {}) => Object.assign({title: {text: title, side: "right"}, thickness: 14, outlinewidth: 0}, changes);
const axis = (title, changes = {}) => Object.assign(
    {
      title: {text: title, standoff: 8},
      gridcolor: faint,
      zeroline: false,
      showline: true,
      linecolor: ink,
      ticks: "outside",
      tickcolor: ink,
      automargin: true
    },
    changes);

// Of an axis: what the values span, with some room.
const range = (values, pad) => {
  const low = Math.min(...values), high = Math.max(...values), room = pad * (high - low || Math.abs(high) || 1);
  return [low - room, high + room];
};

// Buttons of a chart's bar have pictures only, and react to a mouse only.
function nameButtons(plot) {
  for (const button of plot.querySelectorAll(".modebar-btn")) {
    button.setAttribute("role", "button");
    button.setAttribute("aria-label", button.dataset.title || button.getAttribute("data-title"));
    button.tabIndex = 0;
    button.onkeydown = (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      button.click();
    };
  }
}

// A figure's numbers as a table that opens: for whoever does not see the chart. It is made when it is opened.
class NumbersTable {
  constructor(title, rows) {
    const longest = 300;
    this.box = element("details", "", {className: "numbers"});
    this.body = element("div", "", {className: "scroll", tabIndex: 0, role: "region", ariaLabel: `Numbers: ${title}`});
    this.fill = () => {
      if (!this.box.open) return;
      const [head, ...all] = rows(), table = element("table");
      const add = (cells, tag, scope) => {
        const row = element("tr");
        row.append(...cells.map((v) => element(tag, isNumber(v) ? shown(v, 5) : v ?? "", scope ? {scope} : {})));
        table.append(row);
      };
      table.append(element("caption", all.length > longest ? `The first ${longest} of ${all.length} rows; the CSV file has all.` : title));
      add(head, "th", "col");
      all.slice(0, longest).forEach((cells) => add(cells, "td"));
      this.body.replaceChildren(table);
    };
    this.box.append(element("summary", "Numbers as a table"), this.body);
    this.box.addEventListener("toggle", this.fill);
  }
}

class Figure {
  // `rows()` gives the table behind the figure; `name` its file's. Without a title the section's is the figure's.
  constructor(section, id, title, name, rows) {
    this.title = title || section.querySelector("h2").textContent;
    this.box = element("figure", "", {id});
    this.head = element("div", "", {className: "head"});
    if (title) this.head.append(element("h3", title));
    this.csv = element("button", "CSV", {
      className: "csv",
      type: "button",
      title: `Download the data of this figure: ${name}.csv`,
      ariaLabel: `CSV: download the numbers of ${this.title}`
    });
    this.csv.addEventListener("click", () => download(`${name}.csv`, csvText(rows())));
    this.controls = element("span", "", {className: "controls"});
    this.head.append(this.controls, this.csv);
    this.plot = element("div", "", {className: "plot", role: "group", ariaLabel: `Chart: ${this.title}`});
    this.numbers = new NumbersTable(this.title, rows);
    this.text = element("p", "", {className: "note", hidden: true});
    this.caption = element("figcaption");
    this.box.append(this.head, this.plot, this.text, this.caption, this.numbers.box);
    section.append(this.box);
  }

  // A list of choices in the head; `changed` hears the index.
  choice(label, options, changed) {
    const select = element("select");
    const refill = (texts, chosen = 0) => {
      select.replaceChildren(...texts.map((t, i) => element("option", t, {value: i})));
      select.selectedIndex = Math.max(0, chosen);
    };
    refill(options);
    select.addEventListener("change", () => changed(select.selectedIndex));
    const box = element("label", `${label} `);
    box.append(select);
    this.controls.append(box);
    return {refill, select, box};
  }

  reveal() {
    this.text.hidden = true;
    this.plot.hidden = this.csv.hidden = this.controls.hidden = this.numbers.box.hidden = false;
  }

  show(data, layout, caption = "", options = {}) {
    this.reveal();
    this.caption.textContent = caption;
    this.plot.style.height = `${layout.height}px`;
    this.plot.ariaLabel = `Chart: ${this.title}. ${caption}`;
    this.numbers.fill();
    const done = Plotly.react(this.plot, data, chartLayout(layout), Object.assign({}, chartOptions, options))
                     .then(() => nameButtons(this.plot));
    pending.push(done);
    return done;
  }

  // A sentence where there is nothing to draw; the controls stay where another choice may have something.
  say(sentence, otherwise = false) {
    this.plot.hidden = this.csv.hidden = this.numbers.box.hidden = true;
    this.controls.hidden = !otherwise;
    this.caption.textContent = "";
    this.text.hidden = false;
    this.text.textContent = sentence;
  }
}
