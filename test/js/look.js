// Opens a page in headless Chromium, uses it as a person does, and prints what was seen as JSON.
// node look.js CHROMIUM PAGE WIDTH light|dark [with|without WebGL | scriptless]
import { chromium } from 'playwright-core';

const [executablePath, page_file, width, colorScheme, webgl = 'with'] = process.argv.slice(2);
const args = [
  '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync',
  ...(webgl === 'with'
    ? ['--use-angle=swiftshader', '--enable-unsafe-swiftshader']
    : ['--disable-gpu', '--disable-3d-apis']),
];
const browser = await chromium.launch({ executablePath, args });
try {
  const context = await browser.newContext({
    viewport: { width: Number(width), height: 800 }, colorScheme, reducedMotion: 'reduce',
    javaScriptEnabled: webgl !== 'scriptless',
  });
  const page = await context.newPage();
  const said = [];
  page.on('console', (message) => said.push(`${message.type()}: ${message.text()}`));
  page.on('pageerror', (error) => said.push(`error: ${error.message}`));
  const asked = [];
  page.on('request', (request) => asked.push(request.url()));
  await page.goto(`file://${page_file}`);

  // What is drawn: a picture of the view as it is on the screen.
  const seen = async () => {
    await page.evaluate(() => new Promise((done) => {
      requestAnimationFrame(() => requestAnimationFrame(done));
    }));
    return (await page.locator('#stage').screenshot()).toString('base64');
  };
  const text = (selector) => page.locator(selector).allInnerTexts();
  if (webgl === 'scriptless') {
    process.stdout.write(JSON.stringify({
      said,
      rows: await text('.row h3'),
      numbers: await text('.row .number b'),
      hint: await page.locator('#view-hint').textContent(),
      picture: (await page.locator('#stage').screenshot()).toString('base64'),
    }));
    await browser.close();
    process.exit();
  }
  const buttons = page.locator('.row button');
  const count = await buttons.count();
  const views = [];
  for (let k = 0; k < Math.min(count, 6); k += 1) {
    await buttons.nth(k).click();
    views.push({
      name: await page.locator('#view-name').textContent(),
      share: await page.locator('#view-share').textContent(),
      pressed: await page.locator('.row button[aria-pressed="true"]').count(),
      chosen: await page.locator('.row.chosen h3').textContent(),
      picture: await seen(),
    });
  }
  let turned = null;
  if (await page.locator('#stage canvas').count()) {
    const box = await page.locator('#stage').boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width / 2 + 90, box.y + box.height / 2, { steps: 5 });
    await page.mouse.up();
    turned = await seen();
  }
  // From the last row on the screen: the part is to be seen as it turns.
  const inSight = () => page.evaluate(() => {
    const { top, bottom } = document.getElementById('stage').getBoundingClientRect();
    return top >= -1 && bottom <= innerHeight + 1;
  });
  await buttons.nth(count - 1).scrollIntoViewIfNeeded();
  await buttons.nth(count - 1).click();
  const in_sight = [await inSight()];
  await page.evaluate(() => getSelection().selectAllChildren(document.querySelector('h1')));
  await buttons.first().focus();
  await page.keyboard.press('Enter');
  in_sight.push(await inSight());
  const marked = await page.locator('#view-name').textContent();

  // Words in the figures that can be seen: their sizes in pixels, and what is wrong with them.
  const figures = await page.evaluate(() => [...document.querySelectorAll('figure svg')].filter(
    (svg) => svg.getBoundingClientRect().width > 0,
  ).map((svg) => {
    const around = svg.getBoundingClientRect();
    const words = [...svg.querySelectorAll('text')].map((one) => {
      const box = one.getBoundingClientRect();
      return { box, words: one.textContent, pixels: box.height };
    });
    const outside = words.filter(({ box }) => box.left < around.left - 1
      || box.right > around.right + 1 || box.top < around.top - 1
      || box.bottom > around.bottom + 1 || box.right > innerWidth);
    const on_another = words.filter(({ box }, k) => words.slice(k + 1).some(({ box: other }) => (
      Math.min(box.right, other.right) - Math.max(box.left, other.left) > 2
      && Math.min(box.bottom, other.bottom) - Math.max(box.top, other.top) > 5)));
    return {
      name: svg.getAttribute('aria-label'),
      words: words.length,
      smallest: Math.min(...words.map(({ pixels }) => pixels)),
      outside: outside.map(({ words: said_there }) => said_there),
      on_another: on_another.map(({ words: said_there }) => said_there),
    };
  }));
  process.stdout.write(JSON.stringify({
    said,
    asked: asked.filter((url) => !url.startsWith('data:')),
    views,
    turned,
    in_sight,
    marked,
    buttons: count,
    figures,
    rows: await text('.row h3'),
    overflow: await page.evaluate(() => document.documentElement.scrollWidth - innerWidth),
    broken: await page.evaluate(() => [...document.images].filter(
      (image) => image.getAttribute('src') && !image.naturalWidth,
    ).length),
    ids: await page.evaluate(() => [...document.querySelectorAll('[id]')].map((one) => one.id)),
    // Lightness of paper and of ink, 0 to 255.
    colours: await page.evaluate(() => {
      const style = getComputedStyle(document.body);
      return [style.backgroundColor, style.color].map(
        (colour) => Math.max(...colour.match(/\d+/g).slice(0, 3).map(Number)),
      );
    }),
  }));
} finally {
  await browser.close();
}
