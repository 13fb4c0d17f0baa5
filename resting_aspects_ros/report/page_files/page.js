// The 3D view shows the part on a tray in the selected aspect. Without WebGL it shows the picture.
import { makeView } from 'view';

const data = JSON.parse(document.getElementById('scene').textContent);
const stage = document.getElementById('stage');
const rows = [...document.querySelectorAll('.row')].filter((row) => row.querySelector('button'));
const still = matchMedia('(prefers-reduced-motion: reduce)');

function makePicture() {
  const image = document.createElement('img');
  image.alt = '';
  stage.append(image);
  return (row, atOnce, element) => {
    const picture = element.querySelector('img');
    image.hidden = !picture;
    if (picture) image.src = picture.src;
  };
}

stage.replaceChildren();
const view = makeView(stage, data);
const show = view ? view.show : makePicture();
document.getElementById('view-hint').textContent = view
  ? 'Drag to rotate, then zoom with the wheel or two fingers. Select an aspect below.'
  : 'This browser does not support 3D graphics (WebGL). Select an aspect below.';

function choose(element, atOnce = false) {
  const row = data.rows[Number(element.dataset.row)];
  for (const other of rows) {
    other.classList.toggle('chosen', other === element);
    other.querySelector('button').setAttribute('aria-pressed', String(other === element));
  }
  document.getElementById('view-name').textContent = row.name;
  document.getElementById('view-share').textContent = element.querySelector('.number b').textContent;
  show(row, atOnce, element);
}

for (const row of rows) {
  row.addEventListener('click', (event) => {
    // Selecting text in the row, or opening its details, does not select the aspect.
    const selection = getSelection();
    const selectsText = !selection.isCollapsed && row.contains(selection.anchorNode);
    const button = event.target.closest('button');
    if (event.target.closest('details') || (selectsText && !button)) return;
    choose(row);
    stage.scrollIntoView({ block: 'nearest', behavior: still.matches ? 'auto' : 'smooth' });
  });
}
if (rows.length) choose(rows[0], true);
