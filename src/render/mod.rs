//! Pictures of meshes and segments, ray-cast on the CPU.
