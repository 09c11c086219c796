"use strict";
// What the console's page does: shows the facts that the server tells, and sends what a person wants. It decides nothing.

const $ = (id) => document.getElementById(id);
const FACES = [...Array(8).keys()].map((n) => `TC${n + 1}`).concat([...Array(12).keys()].map((n) => `TO${n + 1}`));
const SHORTEST_MM = 189, LONGEST_MM = 279;
const RETRY_MS = 1000;
const STOP_MS = 2000, STOP_AGAIN_MS = 500, GIVE_UP_MS = 10000, SILENT_MS = 2500;
let socket = null, facts = null, heard = 0;
let panel = ""; // which question of a session is shown: a key answers this one and no other
let stopping = 0, again = 0; // since when a stop is asked for and not yet answered; 0: none is

function order(what, more = {}) {
  if (!socket || socket.readyState !== WebSocket.OPEN) return false;
  socket.send(JSON.stringify({ do: what, ...more }));
  return true;
}

// What an order came to. A good answer is told until the robot's state has moved on, a stop while it is in force, a refusal until the
// next order.
const TOLD_MS = 3000; // at least
let toldIn = "", toldAt = 0, over = false; // the state when it was told, when that was, whether the state was another one since

function tell(words, kind) {
  $("told").textContent = inWordsOfThePage(words);
  $("told").className = kind || "";
  [toldIn, toldAt, over] = [facts ? stateOf(facts) : "", Date.now(), false];
}

function forgetWhatIsOver(now) {
  const words = $("told").textContent;
  over = words.startsWith("stopped") ? now.state !== "FAULT" : over || stateOf(now) !== toldIn;
  if (words && over && !stopping && $("told").className !== "bad" && Date.now() - toldAt >= TOLD_MS) tell("", "");
}

const stateOf = (now) => [now.alive && now.state, Boolean(now.roll), Boolean(now.travel), now.last].join();

// The nodes tell people at a terminal which service to call; here there is a button for it.
const BUTTONS = { arm: "press Arm", reset: "press Reset", set_face: "choose it below Face", disarm: "press Disarm" };

function inWordsOfThePage(words) {
  return words
    .replace(/ros2 service call \S*?(disarm|arm|reset|set_face) [\w/]+(?: "\{[^"]*\}")?/g, (_, name) => BUTTONS[name])
    .replace("wait for ARMED in bridge/state", "wait for ARMED");
}

// What the robot does now, in one line.
function doing(now) {
  if (!now.alive) return "no bridge is heard";
  if (now.state === "FAULT") return `${now.reason || "stopped"}; Reset leaves this`;
  if (now.travel) return `travel: ${now.travel.phase}`;
  if (now.roll) return `roll: ${now.roll.phase}`;
  const words = {
    DISARMED: "not armed: nothing moves",
    HOMING: "homing: every strut goes to mid stroke",
    ARMED: `armed${now.holder ? ` for ${now.holder}` : ""}`,
    HOLD: `held${now.reason ? ` (${now.reason})` : ""}: the struts stay where they are`,
  };
  return words[now.state] || now.reason;
}

// A stop is asked for until it is answered, also over a connection that is lost and comes back.
function stop() {
  stopping = stopping || Date.now();
  askToStop();
}

function askToStop() {
  clearTimeout(again);
  const sent = order("stop");
  if (!sent || Date.now() - stopping > STOP_MS) tell("NOT STOPPED as far as this page knows: use the power switch. Still trying …", "bad");
  else tell("stopping …", "bad");
  text("lostStop", sent ? "" : "NOT STOPPED: there is no connection. Use the power switch. Still trying …");
  again = setTimeout(askToStop, STOP_AGAIN_MS);
}

function stopAnswered() {
  clearTimeout(again);
  stopping = 0;
  text("lostStop", "");
}

const at = (path) => new URL(path, location.href);
const socketAt = (path) => at(path).href.replace(/^http/, "ws");

function connect() {
  socket = new WebSocket(socketAt("link"));
  socket.onopen = () => {
    heard = Date.now();
    if (stopping) askToStop();
  };
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    heard = Date.now();
    if (message.page) {
      $("scene").src = `scene?websocket=${encodeURIComponent(socketAt(`scene/${message.page}`))}&hideViserLogo`;
      if (!stopping) tell("", "");
    } else if (message.answer) {
      const { do: what, done, words } = message.answer;
      if (what === "stop" && (done || Date.now() - stopping > GIVE_UP_MS)) stopAnswered();
      tell(done || what === "stop" ? words : `${what}: ${words}`, done ? "good" : "bad");
    } else {
      lost(false);
      show(message);
    }
  };
  socket.onclose = async () => {
    lost(true);
    const reply = await fetch(at("./")).catch(() => null);
    text("retry", reply && reply.status === 403 ? "the console has another address now: open the one that it printed" : "trying again …");
    setTimeout(connect, RETRY_MS);
  };
}

function lost(yes) {
  $("lost").hidden = !yes;
  if (yes) text("lostTitle", "No connection: use the power switch");
}

// A cable that was pulled closes no socket: silence is a lost connection, too.
setInterval(() => {
  if (heard && Date.now() - heard > SILENT_MS) lost(true);
}, 500);

function text(id, value) {
  if ($(id).textContent !== value) $(id).textContent = value;
}

function show(now) {
  facts = now;
  text("state", now.alive ? now.state : "NO BRIDGE");
  $("state").className = `badge ${now.alive ? now.state : ""}`;
  $("state").title = now.reason;
  text("doing", inWordsOfThePage(doing(now)));
  forgetWhatIsOver(now);
  text("face", now.face || "no face");
  text("faceSource", whoSaw(now));
  health(now, "link", now.link_ok ? "open" : "not open", !now.link_ok);
  health(now, "duty", now.duty_left_s === null ? "–" : `${now.duty_left_s.toFixed(0)} s`, now.duty_left_s !== null && now.duty_left_s < 10);
  health(now, "battery", now.battery_v === null ? "not told" : `${now.battery_v.toFixed(2)} V`, warned(now, "battery"));
  health(now, "log", now.bag ? `${now.bag_messages} messages` : "not recording", !now.bag || warned(now, "log"));
  $("logBox").title = now.bag;
  $("virtual").hidden = !now.virtual;
  troubles(now);
  buttons(now);
  neighbours(now);
  journey(now);
  struts(now);
  trial(now.trial);
}

function whoSaw(now) {
  if (!now.source) return now.predicted ? "predicted, nobody looked" : "nobody looked";
  const twin = now.predicted && now.predicted !== now.face ? `; twin: ${now.predicted}` : "";
  let seen = `seen by ${now.source}`;
  if (now.source === "imu") {
    const onto = now.face || !now.observed ? "" : `, rolling onto ${now.observed}`;
    seen = now.observed ? `imu ${now.detail}${onto}` : "imu does not know";
  }
  return `${seen}${now.alive ? "" : " before the bridge fell silent"}${twin}`;
}

function health(now, name, words, bad) {
  text(name, now.alive ? words : "–");
  $(`${name}Box`).classList.toggle("bad", !now.alive || Boolean(bad));
}

function warned(now, part) {
  return now.diagnostics.some(([name, level]) => name === part && level > 0);
}

function troubles(now) {
  const warnings = now.diagnostics.filter(([, level]) => level > 0).map(([name, , words]) => `${name}: ${words}`);
  const list = now.alive ? warnings : ["the hardware bridge is silent: start it, in this ROS domain"];
  if (!now.twin_alive) list.unshift("the twin is silent: what the 3D view shows is old");
  if (now.alive && now.source === "imu" && !now.observed) list.unshift(`the face is not known: ${now.detail}`);
  if (failed(now)) list.push(`the last ${now.last}`);
  $("troubleCard").hidden = !list.length;
  rows("troubles", list, (words) => make("li", { textContent: inWordsOfThePage(words) }));
}

const failed = (now) => / failed/.test(now.last);

const make = (kind, properties) => Object.assign(document.createElement(kind), properties);

// An element's children, one for each part; made anew only when something is different.
function rows(id, parts, child, more = "") {
  const shown = JSON.stringify([parts, more]);
  if ($(id).dataset.shown === shown) return;
  $(id).dataset.shown = shown;
  $(id).replaceChildren(...parts.map(child));
}

const place = (place_m) => `${place_m.map((v) => v.toFixed(2)).join(", ")} m`;

function buttons(now) {
  const busy = Boolean(now.roll || now.travel);
  const armed = now.alive && (now.state === "ARMED" || now.state === "HOLD");
  $("arm").disabled = !(now.alive && now.state === "DISARMED" && $("clear").checked);
  $("clear").disabled = !(now.alive && now.state === "DISARMED");
  $("disarm").disabled = !now.alive || now.state === "DISARMED" || now.state === "FAULT";
  $("reset").disabled = !(now.alive && now.state === "FAULT");
  $("roll").disabled = !(armed && !busy && now.selected);
  $("travel").disabled = !(armed && !busy && now.place_m);
  $("cancel").disabled = !busy;
  text("roll", now.selected ? `Roll to ${now.selected}` : "Roll");
  text("travel", now.place_m ? `Travel to ${place(now.place_m)}` : "Travel there");
}

function neighbours(now) {
  const gaits = now.rehearsal ? [...now.rehearsal.gaits].sort((a, b) => a.target.localeCompare(b.target, "en", { numeric: true })) : [];
  rows("neighbours", gaits, (gait) => {
    const button = make("button", { type: "button", className: gait.target === now.selected ? "chosen" : "" });
    button.dataset.face = gait.target;
    button.append(make("b", { textContent: gait.target }), gait.members ? `${gait.successes} of ${gait.members}` : "");
    button.onclick = () => order("select", { target: gait.target });
    return button;
  }, now.selected);
  text("rollFrom", now.face ? `from ${now.face}` : "");
  const chosen = gaits.find((gait) => gait.target === now.selected);
  if (now.travel) text("foretold", "the rolls of the travel are chosen one after the other");
  else if (!now.face) text("foretold", now.roll ? "" : "it stands on no face that is known: there is no roll to choose now");
  else if (!now.rehearsal) text("foretold", now.trial ? "while a session runs, nothing is rehearsed for this page" : inWordsOfThePage(now.unrehearsed));
  else if (!chosen) text("foretold", `the best gait to each neighbour, tried on ${gaits[0] ? gaits[0].members : 0} perturbed twins: so many rolled`);
  else text("foretold", `${chosen.primitive}: ${chosen.successes} of ${chosen.members} twins rolled; they ended on ${chosen.ends.map(([face, count]) => `${face} ${count}`).join(", ")}`);
  const running = now.roll;
  $("progress").hidden = !running;
  if (running) $("progress").value = running.progress || 0;
  text("phase", running ? `${running.phase}, on ${running.face || "no face"}${rollingOn(running)}` : now.last && !failed(now) ? `the last ${now.last}` : "");
}

function rollingOn(running) {
  if (!running.next_face) return "";
  const words = [` to ${running.next_face}: ${running.rolls} rolls made`];
  if (running.m_per_min !== null) words.push(`${running.m_per_min.toFixed(2)} m/min`);
  if (running.duty_left_s !== null) words.push(`${Math.round(running.duty_left_s)} s of duty left`);
  return words.join(", ");
}

function journey(now) {
  const running = now.travel;
  text("place", now.place_m ? `selected: ${place(now.place_m)}` : "click on the floor for a place");
  if (!running) return text("journey", "");
  const words = [`roll ${running.rolls + 1}: ${running.phase}`];
  if (running.left_m !== null) words.push(`${Math.round(100 * running.left_m)} cm left`);
  if (running.rolls_left) words.push(`${running.rolls_left} rolls planned`);
  if (running.odds !== null) words.push(`probability ${Math.round(100 * running.odds)} %`);
  text("journey", words.join(", "));
}

function struts(now) {
  const box = $("struts");
  if (!box.children.length) {
    for (let s = 1; s <= 6; s += 1) box.insertAdjacentHTML("beforeend", `<span>S${s}</span><div class="bar"><i></i></div><span></span><span></span>`);
  }
  now.lengths_mm.forEach((length, s) => {
    const [, bar, words, force] = [...box.children].slice(4 * s, 4 * s + 4);
    bar.firstChild.hidden = length === null;
    if (length !== null) bar.firstChild.style.left = `${(100 * (length - SHORTEST_MM)) / (LONGEST_MM - SHORTEST_MM)}%`;
    words.textContent = length === null ? "unknown" : `${length.toFixed(1)} mm`;
    force.textContent = now.strut_n[s] === null ? "" : `${now.strut_n[s].toFixed(0)} N`;
  });
}

function trial(shown) {
  panel = shown ? shown.panel || "" : "";
  $("trialCard").hidden = !shown;
  if (!shown) return;
  text("trialTitle", shown.kind || "trials");
  text("trialWhat", `${shown.source} → ${shown.target} ${shown.primitive}`);
  text("trialQuestion", shown.trouble || shown.question || shown.phase);
  const rate = shown.done ? `, ${Math.round((100 * shown.successes) / shown.done)} % succeeded` : "";
  text("trialDone", `${shown.done} of ${shown.total} done${rate}. ${shown.last}`);
  const keys = (shown.keys || []).filter(([key]) => key !== "space"); // the stop has a button of its own
  rows("trialKeys", keys, ([key, meaning]) => {
    const button = make("button", { type: "button", className: `key-${key} ${"uqp".includes(key) ? "small" : ""}` });
    button.dataset.key = key === "Enter" ? "enter" : key;
    button.append(make("kbd", { textContent: key }), meaning);
    button.onclick = () => order("key", { key: button.dataset.key, panel });
    return button;
  });
}

function pressed(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === " " || event.key === "Escape") {
    event.preventDefault(); // also while the key is held: it would press the button that has the focus
    event.stopPropagation();
    if (!event.repeat) stop();
    return;
  }
  if (event.repeat) return;
  if (event.target && /SELECT|INPUT/.test(event.target.tagName)) return;
  const wanted = event.key === "Enter" ? "enter" : event.key;
  const button = [...$("trialKeys").children].find((one) => one.dataset.key === wanted);
  if (button && !$("trialCard").hidden) {
    event.preventDefault();
    button.click();
  }
}

$("stop").onclick = stop;
$("arm").onclick = () => { tell("arming …"); order("arm", { lifted_and_clear: $("clear").checked }); $("clear").checked = false; };
$("disarm").onclick = () => order("disarm");
$("reset").onclick = () => order("reset");
$("roll").onclick = () => order("roll", { target: facts.selected });
$("travel").onclick = () => order("travel", { place_m: facts.place_m });
$("cancel").onclick = () => order("cancel");
$("setFace").onclick = () => order("face", { face: $("faceSelect").value });
$("clear").onchange = () => facts && buttons(facts);
$("faceSelect").append(...FACES.map((face) => new Option(face, face)));
// Space would also click the button that has the focus: the stop comes first, in this page and in the 3D view's.
document.addEventListener("keydown", pressed, true);
document.addEventListener("keyup", (event) => event.key === " " && event.preventDefault(), true);
$("scene").addEventListener("load", () => $("scene").contentWindow.addEventListener("keydown", pressed, true));
connect();
