// Written by lightwell. Checked against C#'s grammar; never run in Unity.
using System.IO;
using UnityEditor;
using UnityEngine;

namespace Lightwell
{
    /// Menu "Lightwell > Apply light": imports the light map, and puts LightwellLight on the selected object.
    /// "Import shader textures": tables of shaders are read texel by texel, their pictures as numbers.
    public static class LightwellImport
    {
        static readonly string[] Lit = { {{ lit }} };

        [MenuItem("Lightwell/Apply light")]
        public static void Apply()
        {
            var target = Selection.activeGameObject;
            if (target == null)
            {
                Debug.LogError("Lightwell: select the root object of scene.glb first");
                return;
            }
            var folder = Path.GetDirectoryName(AssetDatabase.GetAssetPath(MonoScript.FromMonoBehaviour(Attach(target))));
            var light = target.GetComponent<LightwellLight>();
            light.lightMap = LightMap(folder + "/light_map.exr");
            light.lit = Lit;
            light.probeLight = AssetDatabase.LoadAssetAtPath<TextAsset>(folder + "/probe_light.txt");
            EditorUtility.SetDirty(light);
            light.enabled = false;
            light.enabled = true;
        }

        static LightwellLight Attach(GameObject target)
        {
            var light = target.GetComponent<LightwellLight>();
            return light != null ? light : target.AddComponent<LightwellLight>();
        }

        static Texture2D LightMap(string path)
        {
            var importer = AssetImporter.GetAtPath(path) as TextureImporter;
            if (importer == null) return null;
            importer.textureType = TextureImporterType.Lightmap;
            importer.wrapMode = TextureWrapMode.Clamp;
            importer.mipmapEnabled = false;
            importer.SaveAndReimport();
            return AssetDatabase.LoadAssetAtPath<Texture2D>(path);
        }

        [MenuItem("Lightwell/Import shader textures")]
        public static void ImportShaderTextures()
        {
            foreach (var id in AssetDatabase.FindAssets("lightwell_ t:Texture2D", new[] { "Assets/lightwell" }))
            {
                var path = AssetDatabase.GUIDToAssetPath(id);
                var importer = AssetImporter.GetAtPath(path) as TextureImporter;
                if (importer == null || !Path.GetFileName(path).StartsWith("lightwell_")) continue;
                bool isTable = path.EndsWith(".exr");
                importer.textureType = TextureImporterType.Default;
                importer.sRGBTexture = false;
                importer.npotScale = TextureImporterNPOTScale.None;
                importer.textureCompression = TextureImporterCompression.Uncompressed;
                importer.maxTextureSize = 16384;
                importer.wrapMode = TextureWrapMode.Clamp;
                importer.filterMode = isTable ? FilterMode.Point : FilterMode.Bilinear;
                importer.mipmapEnabled = !isTable;
                if (isTable) KeepFloats(importer);
                importer.SaveAndReimport();
            }
        }

        /// Automatic formats of EXR files hold half floats.
        static void KeepFloats(TextureImporter importer)
        {
            var settings = importer.GetDefaultPlatformTextureSettings();
            settings.format = TextureImporterFormat.RGBAFloat;
            importer.SetPlatformTextureSettings(settings);
        }

        [MenuItem("Lightwell/Create light probes")]
        public static void CreateProbes()
        {
            var text = AssetDatabase.LoadAssetAtPath<TextAsset>("Assets/lightwell/probe_light.txt");
            if (text == null) return;
            var lines = text.text.Split(new[] { '\n' }, System.StringSplitOptions.RemoveEmptyEntries);
            var culture = System.Globalization.CultureInfo.InvariantCulture;
            var group = new GameObject("Lightwell probes").AddComponent<LightProbeGroup>();
            group.probePositions = System.Array.ConvertAll(lines, line =>
            {
                var words = line.Split(' ');
                return new Vector3(float.Parse(words[0], culture), float.Parse(words[1], culture), float.Parse(words[2], culture));
            });
        }
    }
}
