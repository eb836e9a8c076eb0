// Draws what the server of this page sends: pictures as they come, points into charts, facts as text.
"use strict";

const WINDOW_S = 30;
const RETRY_MS = 1000;
// A point's columns, as cli/viewer/facts.py sends them.
const T = 0, SLOPE = 1, SLOPE_LOW = 2, SLOPE_HIGH = 3, FRONTAL = 4, SLOPE_TRUE = 5, HEIGHT = 6, HEIGHT_LOW = 7,
  HEIGHT_HIGH = 8, HEIGHT_TRUE = 9, DOWN = 10, ROLL = 11, DELAY = 12;
const COLOURS = { region: "#50dc50", up: "#ffaa3c", other: "#8ab4f8", truth: "#c8c8c8" };
const TEXTS = ["title", "source", "ground", "terrain", "motion", "attitude", "latency", "refused"];

const byId = (id) => document.getElementById(id);
const charts = [];
let points = [];
let run = null;
let socket = null;

function line(colour, dashed) {
  return { stroke: COLOURS[colour], width: 1.5, dash: dashed ? [4, 4] : undefined, points: { show: false } };
}

const edge = { stroke: "transparent", points: { show: false } };

function addChart(id, columns, series, bands, least) {
  const place = byId(id);
  const axis = { stroke: "#9aa0a6", grid: { stroke: "#2c3136", width: 1 }, ticks: { show: false } };
  const chart = new uPlot({
    width: place.clientWidth, height: 150, series: [{}, ...series], bands,
    legend: { show: false }, cursor: { show: false },
    scales: { x: { time: false }, y: { range: (_, low, high) => padded(low, high, least) } },
    axes: [{ ...axis, size: 24, values: (_, all) => all.map((t) => t + " s") }, { ...axis, size: 48 }],
  }, [[], ...columns.map(() => [])], place);
  charts.push({ chart, columns, place });
}

// The range shown is never narrower than `least`, so that noise does not look like motion.
function padded(low, high, least) {
  if (low === null || high === null) return [0, least];
  const middle = (low + high) / 2, half = Math.max(least, 1.1 * (high - low)) / 2;
  return [middle - half, middle + half];
}

function addCharts() {
  const fill = "rgba(80, 220, 80, .25)";
  addChart("slope", [SLOPE, SLOPE_LOW, SLOPE_HIGH, FRONTAL, SLOPE_TRUE],
    [line("region"), edge, edge, line("other"), line("truth", true)], [{ series: [3, 2], fill }], 6);
  addChart("height", [HEIGHT, HEIGHT_LOW, HEIGHT_HIGH, HEIGHT_TRUE],
    [line("region"), edge, edge, line("truth", true)], [{ series: [3, 2], fill }], 6);
  addChart("tilt", [DOWN, ROLL], [line("up"), line("other")], [], 10);
  addChart("delay", [DELAY], [line("other")], [], 20);
  new ResizeObserver(() => charts.forEach(({ chart, place }) => chart.setSize({ width: place.clientWidth, height: 150 })))
    .observe(byId("charts"));
}

function drawCharts() {
  if (points.length === 0) return;
  const newest = points[points.length - 1][T];
  points = points.filter((point) => point[T] > newest - WINDOW_S);
  const t = points.map((point) => point[T]);
  for (const { chart, columns } of charts) {
    chart.setData([t, ...columns.map((column) => points.map((point) => point[column]))], false);
    chart.batch(() => {
      chart.setScale("x", { min: Math.max(0, newest - WINDOW_S), max: Math.max(newest, 5) });
    });
  }
}

// `kind` is good, bad or neither.
function showState(text, kind) {
  const state = byId("state");
  state.textContent = text;
  state.className = "tag " + kind;
}

function showFacts(facts) {
  for (const name of TEXTS) if (facts[name] !== undefined) byId(name).textContent = facts[name];
  byId("source").className = "tag " + (facts.source === "live" ? "good" : "");
  if (facts.latency_of) byId("latency_title").textContent = "From " + facts.latency_of;
  if (facts.ended) showState(facts.ended, facts.source === "recording" ? "" : "bad");
  else if (facts.silent) showState("no data for more than a second", "bad");
  else if (facts.status) showState(facts.status, facts.status === "valid" ? "good" : "bad");
  byId("buttons").hidden = facts.plays === null || facts.plays === undefined;
  byId("pause").textContent = facts.plays ? "Pause" : "Go on";
  byId("pause").dataset.says = facts.plays ? "pause" : "play";
  if (facts.health) {
    byId("health").replaceChildren(...facts.health.map(([name, value]) => {
      const row = document.createElement("tr");
      for (const text of [name, value]) row.insertCell().textContent = text;
      return row;
    }));
  }
}

async function showPicture(data) {
  const picture = await createImageBitmap(new Blob([data], { type: "image/jpeg" }));
  const canvas = byId("picture");
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  canvas.getContext("2d").drawImage(picture, 0, 0);
  canvas.dataset.drawn = String(1 + Number(canvas.dataset.drawn || 0));
}

function take(event) {
  if (event.data instanceof ArrayBuffer) {
    showPicture(event.data);
    return;
  }
  const news = JSON.parse(event.data);
  if (news.facts.runs !== run) {
    run = news.facts.runs;
    points = [];
  }
  points.push(...news.points);
  showFacts(news.facts);
  drawCharts();
}

function connect() {
  points = [];
  socket = new WebSocket(new URL("data", location.href.replace(/^http/, "ws")));
  socket.binaryType = "arraybuffer";
  socket.onmessage = take;
  socket.onclose = () => {
    showState("gaiteyes view has ended", "bad");
    setTimeout(connect, RETRY_MS);
  };
}

window.addEventListener("DOMContentLoaded", () => {
  addCharts();
  byId("pause").onclick = () => socket.send(byId("pause").dataset.says);
  byId("again").onclick = () => socket.send("again");
  connect();
});
