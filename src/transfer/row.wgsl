// Twin: stencil.rs, Rows::multiply. Row `i` of S times x, for a shader that declares the buffers
//   neighbours  27 for each node
//   rows        for each node: its pattern, and its row of the boundary mass
//   patterns    the columns of 27 blocks for each pattern
//   mass        27 for each row
const NONE = 0xffffffffu;
const SLOTS = 27u;

fn multiply_row(i: u32) -> vec3<f32> {
    let row = rows[i];
    var sum0 = vec4<f32>(0.0);
    var sum1 = vec4<f32>(0.0);
    var sum2 = vec4<f32>(0.0);
    for (var k = 0u; k < SLOTS; k++) {
        let j = 3u * neighbours[SLOTS * i + k];
        let column = 3u * (SLOTS * row.x + k);
        sum0 += patterns[column] * x[j];
        sum1 += patterns[column + 1u] * x[j + 1u];
        sum2 += patterns[column + 2u] * x[j + 2u];
    }
    var sum = sum0 + sum1 + sum2;
    if row.y != NONE {
        for (var k = 0u; k < SLOTS; k++) {
            let j = 3u * neighbours[SLOTS * i + k];
            let m = mass[SLOTS * row.y + k];
            sum += m * vec4<f32>(x[j], x[j + 1u], x[j + 2u], 0.0);
        }
    }
    return sum.xyz;
}
