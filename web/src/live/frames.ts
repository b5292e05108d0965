type Draw = (nowMs: number) => void;

const draws = new Set<Draw>();
let handle = 0;

function frame(nowMs: number): void {
  handle = draws.size > 0 ? requestAnimationFrame(frame) : 0;
  for (const draw of draws) draw(nowMs);
}

/** Call `draw` at display rate, from one loop for the whole page, until the returned function is called. */
export function onFrame(draw: Draw): () => void {
  draws.add(draw);
  if (handle === 0) handle = requestAnimationFrame(frame);
  return () => void draws.delete(draw);
}
