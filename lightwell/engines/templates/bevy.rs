// Written by lightwell for Bevy 0.17 and later. Checked against Rust's grammar; never compiled with Bevy.
use bevy::light::{IrradianceVolume, LightProbe};
use bevy::prelude::*;

const LIT: [&str; {{ count }}] = [{{ lit }}];
{% if grid %}

/// The baked probes as an irradiance volume. The intensity is in candelas per square metre per unit of the bake's light.
pub fn spawn_irradiance_volume(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((
        LightProbe::default(),
        IrradianceVolume {
            voxels: assets.load("lightwell/irradiance.ktx2"),
            intensity: 1.0,
            ..default()
        },
        Transform::from_xyz({{ grid.center | floats }}).with_scale(Vec3::new({{ grid.size | floats }})),
    ));
}
{% endif %}
{% if map %}

/// Gives the lit meshes of scene.glb the light map, as soon as they are there.
pub fn apply_light_map(
    mut commands: Commands,
    assets: Res<AssetServer>,
    meshes: Query<(Entity, &ChildOf), (With<Mesh3d>, Without<bevy::pbr::Lightmap>)>,
    names: Query<&Name>,
) {
    for (entity, parent) in &meshes {
        let Ok(name) = names.get(parent.parent()) else { continue };
        if LIT.contains(&name.as_str()) {
            commands.entity(entity).insert(bevy::pbr::Lightmap {
                image: assets.load("lightwell/light_map.ktx2"),
                ..default()
            });
        }
    }
}
{% endif %}
