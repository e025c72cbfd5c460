// The index of an invocation in a dispatch that may use two dimensions.
fn invocation(gid: vec3<u32>, groups: vec3<u32>) -> u32 {
    return gid.x + gid.y * (groups.x * 64u);
}
