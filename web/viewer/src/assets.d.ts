/** Files that the build carries inside the page. */
declare module "*.lwsp?inline" {
  /** A data address. */
  const address: string;
  export default address;
}
