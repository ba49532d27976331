"""The bake: a scene in, a glTF with learned light, a page and a report out; and the comparison of fields."""
