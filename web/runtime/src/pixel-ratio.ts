/** Hears when a page comes to have other pixels per CSS pixel: on another screen, where no size of an element changes. */

/** Call `changed` after each change of `devicePixelRatio`. Returns a function that ends it. */
export function onPixelRatio(changed: () => void): () => void {
  let query: MediaQueryList;
  const heard = () => {
    listen();
    changed();
  };
  // A query holds for one ratio: the next change is that of another query.
  const listen = () => {
    query = matchMedia(`(resolution: ${devicePixelRatio}dppx)`);
    query.addEventListener("change", heard, { once: true });
  };
  listen();
  return () => query.removeEventListener("change", heard);
}
