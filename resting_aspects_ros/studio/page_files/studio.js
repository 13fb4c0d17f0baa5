// The page: shows what the server sends, and sends what the user changes. It calculates nothing.
import { makeView } from 'view';

const RETRY_MS = 1000;
// The first shares are shown before the 3D view, which takes half a second without a GPU.
const VIEW_DELAY_MS = 600;
const find = (selector, within = document) => within.querySelector(selector);
const all = (selector, within = document) => [...within.querySelectorAll(selector)];
const narrow = matchMedia('(max-width: 900px)');

let socket = null;
let room = sessionStorage.getItem('room') || '';
let ready = false; // whether the server has named the room
let waiting = []; // what to do when it has
let sent = 0; // number of the last change
let values = {}; // of all controls
let view = null;
let scene = null;
let chosen = 0; // row in the 3D view
let viewing = 0; // timer
let opening = 'first'; // side for which a file is chosen

// -- The socket ---------------------------------------------------------------------------------

function connect() {
  socket = new WebSocket(new URL('socket', location.href.replace(/^http/, 'ws')));
  socket.addEventListener('open', () => socket.send(JSON.stringify({ room })));
  socket.addEventListener('message', (event) => receive(JSON.parse(event.data)));
  socket.addEventListener('close', () => {
    ready = false;
    setText(find('#problem'), 'The server has ended. Start resting_aspects studio again.');
    setTimeout(connect, RETRY_MS);
  });
}

function send(message) {
  if (ready) socket.send(JSON.stringify(message));
  else waiting.push(() => send(message));
}

function change(name, value) {
  sent += 1;
  values[name] = value;
  for (const other of all(`[data-set="${name}"]`)) if (other !== document.activeElement) fill(other);
  send({ set: name, to: value, number: sent });
}

function receive(message) {
  const { topic } = message;
  if (topic in handlers) handlers[topic](message);
  else if ('html' in message) showSlot(find(`[data-slot="${topic}"]`), message.html);
  else showText(topic, message.text);
}

const handlers = {
  room(message) {
    room = message.room;
    sessionStorage.setItem('room', room);
    setText(find('#problem'), '');
    ready = true;
    waiting.splice(0).forEach((task) => task());
  },
  problem({ text }) { setText(find('#problem'), text); },
  opening({ text }) {
    find('#opening').hidden = !text;
    find('#opening span').textContent = text;
  },
  part({ name, facts }) {
    // Its rows, with a stage for the view, and its scene follow.
    clearTimeout(viewing);
    view?.dispose();
    view = null;
    scene = null;
    document.body.classList.remove('empty');
    document.title = `${name}: resting_aspects studio`;
    find('#name').textContent = name;
    find('#facts').textContent = facts;
  },
  first(message) { showChoices('first', message); },
  second(message) { showChoices('second', message); },
  scene(message) {
    scene = message.scene;
    choose(0, true);
    clearTimeout(viewing);
    viewing = setTimeout(showView, VIEW_DELAY_MS);
  },
  bars({ rows, caption, pickable }) {
    rows.forEach(showRow);
    if (caption) showText('caption', caption);
    showText('pickable', pickable ?? '');
    showShare();
  },
  values(message) {
    // Answers to earlier changes would move a slider back while it is dragged.
    if (message.number !== undefined && message.number < sent) return;
    values = message.values;
    for (const control of all('[data-set]')) fill(control);
    showTab(message.tab);
    showPickable();
  },
};

function showText(topic, text) {
  for (const element of all(`[data-text="${topic}"]`)) element.textContent = text;
}

function setText(element, text) {
  element.hidden = !text;
  element.textContent = text;
}

// -- Slots and controls -------------------------------------------------------------------------

function showSlot(slot, html) {
  if (!slot) return;
  const focused = slot.contains(document.activeElement) ? document.activeElement : null;
  const open = new Set(all('details[data-keep][open]', slot).map((each) => each.dataset.keep));
  slot.innerHTML = html;
  for (const each of all('details[data-keep]', slot)) each.open = open.has(each.dataset.keep);
  for (const control of all('[data-set]', slot)) fill(control);
  for (const link of all('a[data-file]', slot)) link.href = `file/${room}/${link.dataset.file}`;
  for (const select of all('select[data-example]', slot)) {
    select.append(...all('[data-example="first"] option').slice(1).map((each) => each.cloneNode(true)));
  }
  if (focused?.id) {
    const next = document.getElementById(focused.id);
    // A field that is used keeps its text and what is selected in it.
    if (next?.type === 'number' && focused.type === 'number') {
      for (const { name, value } of next.attributes) focused.setAttribute(name, value);
      next.replaceWith(focused);
    }
    document.getElementById(focused.id)?.focus();
  }
  if (slot.dataset.slot === 'aspects') prepareRows(slot);
}

// A control that is used is not changed.
function fill(control) {
  const value = values[control.dataset.set];
  if (control.type === 'checkbox') control.checked = Boolean(value);
  else if (control !== document.activeElement || control.type === 'range') {
    if (value !== undefined && control.value !== value) control.value = value;
  }
}

function changedControl(event) {
  const control = event.target;
  if (control.dataset?.set) {
    const value = control.type === 'checkbox' ? control.checked : control.value;
    if (value !== '' || control.id === 'cell.parts_on_tray' || control.id.startsWith('count.')) change(control.dataset.set, value);
  }
}
document.addEventListener('input', (event) => {
  if (event.target.tagName === 'INPUT' && event.target.type !== 'file') changedControl(event);
});
document.addEventListener('focusout', ({ target }) => {
  if (target.dataset.set) setTimeout(() => fill(target)); // what came while it was used
});
document.addEventListener('change', (event) => {
  const control = event.target;
  if (control.tagName === 'SELECT' && control.dataset.set) changedControl(event);
  if (control.dataset.example && control.value) {
    send({ example: control.value, side: control.dataset.example });
    control.value = '';
  }
  const { again } = control.dataset;
  if (again) {
    const to = again === 'body' ? Number(control.value) : control.value;
    send({ again, to, side: control.closest('[data-side]').dataset.side });
  }
  if (control.id === 'file' && control.files.length) {
    upload(control.files[0], opening);
    control.value = '';
  }
});
document.addEventListener('click', (event) => {
  const button = event.target.closest('button');
  if (!button) return;
  const { tab, open, pick, clear, set, value } = button.dataset;
  const task = button.dataset.do;
  if (tab) chooseTab(tab);
  else if (open) {
    opening = open;
    find('#file').click();
  } else if (pick) change(`pickable.${pick}`, button.getAttribute('aria-pressed') !== 'true');
  else if (clear) change(clear, '');
  else if (set) change(set, value);
  else if (task === 'more' || task === 'fit') change(task, true);
  else if (task) {
    send({ do: task });
    if (task === 'cancel') handlers.opening({ text: '' });
  }
});

// Units and bodies of the file of a side; most files have no choice.
function showChoices(side, { unit, bodies, body }) {
  const place = find(`[data-side="${side}"]`);
  const [units, list] = all('select', place);
  list.replaceChildren(...bodies.map((text, number) => new Option(text, number)));
  list.value = body;
  if (unit) units.value = unit;
  units.parentElement.hidden = !unit;
  list.parentElement.hidden = !bodies.length;
  place.hidden = !unit && !bodies.length;
}

// -- Tabs ---------------------------------------------------------------------------------------

function chooseTab(name) {
  showTab(name);
  change('tab', name);
}

function showTab(name) {
  for (const tab of all('[role=tab]')) {
    const selected = tab.dataset.tab === name;
    tab.setAttribute('aria-selected', String(selected));
    tab.tabIndex = selected ? 0 : -1;
    find(`#panel-${tab.dataset.tab}`).hidden = !selected;
  }
}

find('[role=tablist]').addEventListener('keydown', (event) => {
  const tabs = all('[role=tab]');
  const at = tabs.indexOf(document.activeElement);
  const to = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: tabs.length - 1 }[event.key];
  if (to === undefined || at < 0) return;
  event.preventDefault();
  const next = tabs[(to + tabs.length) % tabs.length];
  next.focus();
  chooseTab(next.dataset.tab);
});

// -- Rows and the 3D view -----------------------------------------------------------------------

function prepareRows(slot) {
  all('.row', slot).forEach((row, number) => {
    if (!find('dl', row)) return; // in no aspect
    const button = find('#pick').content.firstElementChild.cloneNode(true);
    button.dataset.pick = number + 1;
    button.setAttribute('aria-label', `pickable: ${find('h3', row).textContent.trim()}`);
    find('.share', row).append(button);
    row.addEventListener('click', (event) => {
      if (!event.target.closest('.pick') && getSelection().isCollapsed) choose(number);
    });
  });
  showPickable();
}

function showPickable() {
  for (const button of all('.pick')) {
    button.setAttribute('aria-pressed', String(Boolean(values[`pickable.${button.dataset.pick}`])));
  }
}

function showRow(texts, number) {
  const row = find(`#panel-aspects .row[data-row="${number}"]`);
  if (!row) return;
  row.hidden = texts.hidden;
  row.classList.toggle('unseen', texts.unseen);
  find('.number b', row).textContent = texts.probability;
  for (const name of ['interval', 'range', 'count']) {
    find(`.number .${name}`, row).textContent = texts[name];
  }
  const [fill_, left, width] = texts.bar;
  find('.fill', row).style.width = `${fill_}%`;
  Object.assign(find('.whisker', row).style, { left: `${left}%`, width: `${width}%` });
  let model = find('.model', row);
  if (texts.model) {
    if (!model) {
      model = document.createElement('i');
      model.className = 'model';
      find('.bar', row).prepend(model);
    }
    Object.assign(model.style, { left: `${texts.model[0]}%`, width: `${texts.model[1]}%` });
  } else model?.remove();
}

function showView() {
  const stage = find('#stage');
  if (!stage || !scene?.rows) return;
  view?.dispose();
  const picture = find('img', stage);
  view = makeView(stage, scene);
  if (view) {
    picture?.remove();
    find('#view-hint').textContent = 'Drag to rotate, then zoom with the wheel or two fingers.';
  }
  choose(chosen, true);
}

function choose(number, atOnce = false) {
  chosen = number;
  all('#panel-aspects .row').forEach((row, k) => {
    row.classList.toggle('chosen', k === number);
    find('.pictures button', row)?.setAttribute('aria-pressed', String(k === number));
  });
  const row = find(`#panel-aspects .row[data-row="${number}"]`);
  if (!row || !scene?.rows) return;
  if (view) view.show(scene.rows[number], atOnce);
  else if (find('#stage img') && find('img', row)) find('#stage img').src = find('img', row).src;
  find('#view-name').textContent = scene.rows[number].name;
  showShare();
}

function showShare() {
  const share = find(`#panel-aspects .row[data-row="${chosen}"] .number b`);
  if (share && find('#view-share')) find('#view-share').textContent = share.textContent;
}

// -- Files --------------------------------------------------------------------------------------

async function upload(file, side) {
  if (!ready) {
    waiting.push(() => upload(file, side));
    return;
  }
  const address = `part/${room}/${side}?name=${encodeURIComponent(file.name)}`;
  handlers.opening({ text: `Reading ${file.name} ...` });
  try {
    const answer = await fetch(address, { method: 'PUT', body: file });
    if (!answer.ok) handlers.problem({ text: await answer.text() });
    if (!answer.ok) handlers.opening({ text: '' });
  } catch {
    handlers.problem({ text: `${file.name} could not be sent to the server.` });
    handlers.opening({ text: '' });
  }
}

document.addEventListener('dragover', (event) => {
  event.preventDefault();
  document.body.classList.add('dragging');
});
document.addEventListener('dragleave', (event) => {
  if (!event.relatedTarget) document.body.classList.remove('dragging');
});
document.addEventListener('drop', (event) => {
  event.preventDefault();
  document.body.classList.remove('dragging');
  const [file] = event.dataTransfer.files;
  if (file) upload(file, values && find('#panel-compare').hidden === false ? 'second' : 'first');
});

if (narrow.matches) find('#conditions').open = false;
connect();
