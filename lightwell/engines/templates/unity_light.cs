// Written by lightwell. Checked against C#'s grammar; never run in Unity.
using System;
using UnityEngine;
using UnityEngine.Rendering;

namespace Lightwell
{
    /// Gives the renderers below this object the light map and, where the scene has light probes, their light.
    [ExecuteAlways]
    public sealed class LightwellLight : MonoBehaviour
    {
        public Texture2D lightMap;
        public string[] lit = Array.Empty<string>();
        /// Nine harmonics of three colours a probe, in the order of LightwellData.
        public TextAsset probeLight;

        void OnEnable()
        {
            if (lightMap != null) ApplyLightMap();
            if (probeLight != null) ApplyProbes();
        }

        void ApplyLightMap()
        {
            LightmapSettings.lightmapsMode = LightmapsMode.NonDirectional;
            LightmapSettings.lightmaps = new[] { new LightmapData { lightmapColor = lightMap } };
            foreach (var target in GetComponentsInChildren<MeshRenderer>(true))
            {
                if (Array.IndexOf(lit, target.gameObject.name) < 0) continue;
                target.lightmapIndex = 0;
                target.lightmapScaleOffset = new Vector4(1f, 1f, 0f, 0f);
            }
        }

        /// Unity keeps the places of its probes: those that were baked are given the light of the nearest of ours.
        void ApplyProbes()
        {
            var probes = LightmapSettings.lightProbes;
            if (probes == null || probes.count == 0) return;
            var numbers = ReadNumbers(probeLight.text);
            var places = probes.positions;
            var light = new SphericalHarmonicsL2[places.Length];
            for (int i = 0; i < places.Length; i++) light[i] = Harmonics(numbers, Nearest(numbers, places[i]));
            probes.bakedProbes = light;
        }

        static float[] ReadNumbers(string text)
        {
            var words = text.Split(new[] { ' ', '\n' }, StringSplitOptions.RemoveEmptyEntries);
            var culture = System.Globalization.CultureInfo.InvariantCulture;
            return Array.ConvertAll(words, word => float.Parse(word, culture));
        }

        // A probe is 30 numbers: its place, then nine harmonics of red, green and blue.
        static int Nearest(float[] numbers, Vector3 place)
        {
            int best = 0;
            float least = float.MaxValue;
            for (int at = 0; at < numbers.Length; at += 30)
            {
                var step = place - new Vector3(numbers[at], numbers[at + 1], numbers[at + 2]);
                if (step.sqrMagnitude >= least) continue;
                least = step.sqrMagnitude;
                best = at;
            }
            return best;
        }

        static SphericalHarmonicsL2 Harmonics(float[] numbers, int at)
        {
            var result = new SphericalHarmonicsL2();
            for (int k = 0; k < 9; k++)
                for (int c = 0; c < 3; c++) result[c, k] = numbers[at + 3 + 3 * k + c];
            return result;
        }
    }
}
