// Where maps contradict each other: red layers, one for each part that lies as it was solved.

import { surface } from './pictures.js';
import { compose } from './poses.js';

/** Loads the layers of the state, if they are wanted and not there yet. */
export async function loadMarks(app) {
  const { state, scene, bench } = app;
  const isWanted = document.getElementById('conflicts').checked;
  const key = JSON.stringify([state.solve, state.parts.map(p => p.pose), isWanted]);
  if (key === app.marksOf) return;
  app.marksOf = key;
  const parts = isWanted ? state.parts.filter(p => p.conflict_cells > 0 && p.pose) : [];
  const marks = await Promise.all(parts.map(async part => {
    const reply = await fetch(bench.url(`conflicts/${part.index}.png?solve=${state.solve}`));
    if (!reply.ok) return null;
    const bitmap = await createImageBitmap(await reply.blob());
    const canvas = surface(bitmap.width, bitmap.height);
    canvas.getContext('2d').drawImage(bitmap, 0, 0);
    return { canvas, pose: compose(part.pose, part.origin), resolution: part.resolution, height: bitmap.height };
  }));
  if (app.marksOf !== key) return;
  scene.marks = marks.filter(Boolean);
  scene.stale();
}
