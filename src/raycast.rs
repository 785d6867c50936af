//! Ray casts against triangle meshes: the one module that speaks the types of parry.
