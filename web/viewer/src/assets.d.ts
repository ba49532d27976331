/** Files that the build carries inside the page. */
declare module "*.lwsp?inline" {
  /** A data address. */
  const address: string;
  export default address;
}

/** The modules that the page's script shares with the packed one of the lens, in the order in which that expects them. */
declare module "virtual:lens-shared" {
  const modules: readonly unknown[];
  export default modules;
}
