declare module "gltf-validator" {
  interface Issue {
    code: string;
    severity: number;
    message: string;
    pointer: string;
  }
  const validator: { validateBytes(data: Uint8Array): Promise<{ issues: { messages: Issue[] } }> };
  export default validator;
}
