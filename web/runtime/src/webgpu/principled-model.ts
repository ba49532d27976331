/** The path tracer's surface model for the rasterised light of `WebGPURenderer`: `principled.ts` in nodes, and where its shadows are tested. */

import type { MeshStandardMaterial } from "three";
import { diffuseColor, float, metalness, mix, normalView, positionViewDirection, roughness, select, specularColor, vec3 } from "three/tsl";
import { PhysicalLightingModel } from "three/webgpu";
import type { AnyNode } from "./field-nodes.ts";

/** A material without specular reflectance is Lambertian. */
const MATTE = 1e-5;
/** Cosines and widths of a lobe are at least this: they divide. */
const LEAST = 1e-3;

/** What three.js hands to a model for each light. */
interface DirectInput {
  readonly lightDirection: AnyNode;
  readonly lightColor: AnyNode;
  readonly lightNode: AnyNode;
  readonly reflectedLight: { readonly directDiffuse: AnyNode; readonly directSpecular: AnyNode };
}

const number = float as AnyNode;
const schlick = (cosine: AnyNode): AnyNode => cosine.oneMinus().clamp().pow(5);

/** Fresnel's equations for a dielectric of reflectance `f0` at normal incidence. */
function fresnel(f0: AnyNode, cosine: AnyNode): AnyNode {
  const eta = f0.sqrt().add(1).div(f0.sqrt().oneMinus().max(LEAST));
  const g = eta.mul(eta).sub(1).add(cosine.mul(cosine)).max(0).sqrt();
  const a = g.sub(cosine).div(g.add(cosine));
  const b = cosine.mul(g.add(cosine)).sub(1).div(cosine.mul(g.sub(cosine)).add(1));
  return a.mul(a).mul(b.mul(b).add(1)).mul(0.5);
}

/** Shadowing and masking of GGX towards one side. */
function smith(alpha2: AnyNode, cosine: AnyNode): AnyNode {
  const square = cosine.mul(cosine);
  return number(2).div(alpha2.mul(square.oneMinus()).div(square).add(1).sqrt().add(1));
}

/** What three.js, which takes every lamp for 0.1 m away at least, leaves out of the light of a nearer one. */
function nearness(lightNode: AnyNode, builder: unknown): AnyNode {
  const decay = lightNode.decayExponentNode;
  if (!decay) return number(1);
  return number(0.01).div(lightNode.getLightVector(builder).length().pow(decay)).clamp(1, 1e4);
}

/** Direct light as `principledLight` has it; coat and sheen are three.js'. */
class PrincipledModel extends (PhysicalLightingModel as AnyNode) {
  direct(input: DirectInput, builder: unknown): void {
    const { lightDirection, reflectedLight } = input;
    const lightColor = input.lightColor.mul(nearness(input.lightNode, builder));
    if (this.clearcoat || this.sheen) {
      const base = { directDiffuse: (vec3 as AnyNode)(0).toVar(), directSpecular: (vec3 as AnyNode)(0).toVar() };
      super.direct({ ...input, lightColor, reflectedLight: base }, builder);
    }
    const [normal, view] = [normalView as AnyNode, positionViewDirection as AnyNode];
    const [rough, metal] = [roughness as AnyNode, metalness as AnyNode];
    const halfway = lightDirection.add(view).normalize();
    const facing = normal.dot(lightDirection).clamp();
    const irradiance = facing.mul(lightColor).toVar();
    const nl = facing.max(LEAST).toVar();
    const nv = normal.dot(view).max(LEAST).toVar();
    const hv = halfway.dot(view).clamp().toVar();
    const nh = normal.dot(halfway).clamp().toVar();
    const f0 = specularColor as AnyNode;
    const dielectric = f0.x.max(f0.y).max(f0.z).toVar();
    const isMatte = dielectric.lessThan(MATTE);

    // Diffuse lobe, with its retro-reflection.
    const retro = rough.mul(hv).mul(hv).mul(2);
    const [sv, sl] = [schlick(nv), schlick(nl)];
    const shape = sv.mul(0.5).oneMinus().mul(sl.mul(0.5).oneMinus()).add(retro.mul(sv.add(sl).add(sv.mul(sl).mul(retro.sub(1)))));
    const albedo = (diffuseColor as AnyNode).rgb.mul(metal.oneMinus());
    reflectedLight.directDiffuse.addAssign(irradiance.mul(albedo).mul((select as AnyNode)(isMatte, number(1), shape)).div(Math.PI));

    // Specular lobe.
    const alpha = rough.mul(rough).max(LEAST);
    const alpha2 = alpha.mul(alpha).toVar();
    const d = nh.mul(nh).mul(alpha2.sub(1)).add(1);
    const lobe = alpha2.div(d.mul(d).mul(Math.PI)).mul(smith(alpha2, nl)).mul(smith(alpha2, nv)).div(nv.mul(nl).mul(4));
    const glass = (select as AnyNode)(isMatte, number(0), fresnel(dielectric, hv));
    const conductor = (mix as AnyNode)((diffuseColor as AnyNode).rgb, (vec3 as AnyNode)(1), schlick(hv));
    reflectedLight.directSpecular.addAssign(irradiance.mul(lobe).mul((mix as AnyNode)((vec3 as AnyNode)(glass), conductor, metal)));
  }
}

/** What the material of nodes that three.js makes of a standard or physical one is asked for its model. */
export function setupLightingModel(this: MeshStandardMaterial & Readonly<Record<`use${string}`, boolean>>): unknown {
  const parts = ["Clearcoat", "Sheen", "Iridescence", "Anisotropy", "Transmission", "Dispersion"] as const;
  return new (PrincipledModel as AnyNode)(...parts.map((part) => this[`use${part}`] ?? false));
}
