/** Takes the lens out of the page's script: most pages are looked at without it, and a browser reads all of a script before it runs. */

import { createHash } from "node:crypto";
import { fileURLToPath } from "node:url";
import { gzipSync } from "three/addons/libs/fflate.module.js";
import { build, type InlineConfig, parseAst, type Plugin, type Rollup } from "vite";

const here = (path: string): string => fileURLToPath(new URL(path, import.meta.url));

/** A module that both the page and the lens use, and the names that the lens imports of it. */
interface Shared {
  readonly id: string;
  readonly names: ReadonlySet<string>;
}

interface Part {
  /** A script that sets `lightwellLens`: a function of the shared modules, in their order, to what `lens-picture.ts` exports. */
  readonly code: string;
  readonly shared: readonly Shared[];
  /** Modules that it has itself. */
  readonly own: readonly string[];
}

/** The module through which the page's script hands over what is shared. */
const SHARED = "\0lens-shared";
const PLACE = "<!--lightwell-lens-->";

/**
 * Builds the viewer's `lens-part.ts` as `packed-lens-part.ts`: the page carries the lens compressed in a script of its own, which is run when the
 * lens is first used. What both use is in the page's script alone.
 *
 * @param config How modules are found, as the page's build has it.
 */
export function lensPart(config: InlineConfig): Plugin {
  let part: Part | undefined;
  return {
    ...packed(() => part?.shared ?? []),
    async buildStart() {
      part = partOf(await bundled(config, here("viewer/src/lens-picture.ts"), shares(await modulesOfPage(config))));
    },
    generateBundle(_, files) {
      const page = Object.values(files).flatMap((one) => (one.type === "chunk" ? Object.keys(one.modules) : []));
      // The bundler's own helpers have no state.
      const twice = page.filter((id) => part!.own.includes(id) && !id.startsWith("\0rolldown/"));
      if (twice.length > 0) throw new Error(`lens-part: both in the page's script and in that of the lens: ${twice.join(", ")}`);
    },
    transformIndexHtml: { order: "post", handler: (html) => html.replace(PLACE, () => element(part!.code)) },
  };
}

/** Modules of the page's script without the lens. */
async function modulesOfPage(config: InlineConfig): Promise<ReadonlySet<string>> {
  const { modules } = await bundled(config, here("viewer/src/main.ts"), packed(() => []));
  return new Set(Object.keys(modules));
}

/** Puts the packed part in the place of the plain one. */
function packed(shared: () => readonly Shared[]): Plugin {
  return {
    name: "lens-part",
    enforce: "pre",
    apply: "build",
    resolveId(source) {
      if (source === "./lens-part.ts") return here("viewer/src/packed-lens-part.ts");
      return source === "virtual:lens-shared" ? SHARED : null;
    },
    load(id) {
      if (id !== SHARED) return null;
      const modules = shared().map(({ id, names }, i) => ({ id, pairs: [...names].map((name) => [name, `m${i}_${name}`]) }));
      const imports = modules.map(({ id, pairs }) => `import { ${pairs.map((pair) => pair.join(" as ")).join(", ")} } from ${JSON.stringify(id)};`);
      const values = modules.map(({ pairs }) => `{ ${pairs.map((pair) => pair.join(": ")).join(", ")} }`);
      return `${imports.join("\n")}\nexport default [${values.join(", ")}];`;
    },
  };
}

/** Leaves out what the page has. */
function shares(page: ReadonlySet<string>): Plugin {
  return {
    name: "lens-shares",
    enforce: "pre",
    async resolveId(source, importer, options) {
      const found = importer ? await this.resolve(source, importer, { ...options, skipSelf: true }) : null;
      return found && page.has(found.id) ? { id: `shared:${found.id}`, external: true } : null;
    },
  };
}

/** One minified module. */
async function bundled(config: InlineConfig, input: string, plugin: Plugin): Promise<Rollup.OutputChunk> {
  const made = await build({
    ...config,
    configFile: false,
    logLevel: "error",
    plugins: [plugin],
    build: {
      ...config.build,
      write: false,
      modulePreload: false,
      rollupOptions: { input, preserveEntrySignatures: "strict", output: { format: "es", codeSplitting: false, minify: true } },
    },
  });
  const { output } = (Array.isArray(made) ? made[0] : made) as Rollup.RollupOutput;
  return output.find((one): one is Rollup.OutputChunk => one.type === "chunk")!;
}

/** A module as a function of what it imports: a script that is run later in the page cannot import from the page's own. */
function partOf({ code, modules }: Rollup.OutputChunk): Part {
  const shared = new Map<string, Set<string>>();
  const constants: string[] = [];
  let [body, exported] = ["", ""];
  for (const node of parseAst(code).body as any[]) {
    if (node.type === "ImportDeclaration") {
      const id = node.source.value.slice("shared:".length);
      if (node.source.value !== `shared:${id}`) throw new Error(`lens-part: the lens imports '${node.source.value}', which the page does not have`);
      if (!shared.has(id)) shared.set(id, new Set());
      const pairs = node.specifiers.map((one: any) => {
        if (one.type !== "ImportSpecifier") throw new Error(`lens-part: the lens imports all of '${id}'; import names`);
        return [one.imported.name, one.local.name];
      });
      for (const [name] of pairs) shared.get(id)!.add(name);
      constants.push(`{${pairs.map((pair: string[]) => pair.join(":")).join(",")}}=shared[${[...shared.keys()].indexOf(id)}]`);
    } else if (node.type === "ExportNamedDeclaration" && !node.declaration && !node.source) {
      exported = node.specifiers.map((one: any) => `${one.exported.name}:${one.local.name}`).join(",");
    } else if (node.type.startsWith("Export")) {
      throw new Error(`lens-part: ${node.type} is not understood`);
    } else {
      body += `${code.slice(node.start, node.end)}\n`;
    }
  }
  return {
    code: `lightwellLens=function(shared){"use strict";const ${constants.join(",")};\n${body}return{${exported}}}`,
    shared: [...shared].map(([id, names]) => ({ id, names })),
    own: Object.keys(modules),
  };
}

/** The script in the page. Its hash is that of what runs: content security policies name it. */
function element(code: string): string {
  const bytes = Buffer.from(code);
  // Of zlib's compression other versions and processors make other bytes.
  const text = Buffer.from(gzipSync(bytes, { level: 9, mtime: 0 })).toString("base64");
  const hash = createHash("sha256").update(bytes).digest("base64");
  return `<script type="application/gzip;base64" data-bytes="${bytes.length}" data-sha256="${hash}" id="lightwell-lens">${text}</script>`;
}
