"""The bake of a scene to a glTF asset with learned light, a page and a report; and the comparison of fields."""
