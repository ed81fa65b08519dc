// Entry points of the runtime itself: arrays of queries, and the pixels of a view.

@group(1) @binding(0) var<storage, read_write> umb_queries: array<vec4<u32>>;
// First query, queries from there, root, structure.
@group(1) @binding(1) var<uniform> umb_range: vec4<u32>;

fn umb_index(id: vec3<u32>, groups: vec3<u32>) -> u32 {
    return id.x + id.y * groups.x * UMB_WORKGROUP;
}

fn umb_note_ancestor(d: UmbAnswer) {
    if d.missing != UMB_NO_PAGE {
        atomicAdd(&umb_feedback[1], 1u);
    }
}

// In: x, y, level, depth rounded up. Out, in place: value, state, missing page, page of the answer.
@compute @workgroup_size(UMB_WORKGROUP)
fn answer(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = umb_index(id, groups);
    if i >= umb_range.y {
        return;
    }
    umb_select(umb_range.w);
    let q = umb_queries[umb_range.x + i];
    if umb_outside(q.x, q.y) {
        umb_queries[umb_range.x + i] = vec4<u32>(UMB_UNCOVERED, UMB_LIT | UMB_OUTSIDE | UMB_EXACT, UMB_NO_PAGE, UMB_NO_PAGE);
        return;
    }
    let d = umb_answer(umb_range.z, q.x, q.y, q.z);
    umb_note_ancestor(d);
    umb_queries[umb_range.x + i] = vec4<u32>(d.value, umb_state(d, q.w) | umb_stale(q.x, q.y), d.missing, d.page);
}

// In: x, y, depth rounded up, state of the frame before with the level asked for from UMB_WORD_SHIFT on. Out: state, the level
// asked for in place of the word. A pixel that is exact stays as it is, and lets go of its pages.
@compute @workgroup_size(UMB_WORKGROUP)
fn pixels(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = umb_index(id, groups);
    if i >= umb_range.y {
        return;
    }
    let q = umb_queries[umb_range.x + i];
    if (q.w & UMB_EXACT) != 0u {
        return;
    }
    umb_select(umb_range.w);
    let level = q.w >> UMB_WORD_SHIFT;
    let state = umb_shadow(umb_range.z, q.x, q.y, level, q.z);
    if (state & UMB_EXACT) == 0u {
        atomicAdd(&umb_feedback[1], 1u);
    }
    umb_queries[umb_range.x + i].w = (state & ((1u << UMB_WORD_SHIFT) - 1u)) | (level << UMB_WORD_SHIFT);
}

// Two words of four for each query. In: x, y, depth rounded up, state of the frame before; gradient, level of detail,
// side. Out: state. What is exact stays as it is.
@compute @workgroup_size(UMB_WORKGROUP)
fn filtered(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = umb_index(id, groups);
    if i >= umb_range.y {
        return;
    }
    let at = 2u * (umb_range.x + i);
    let q = umb_queries[at];
    if (q.w & UMB_EXACT) != 0u {
        return;
    }
    umb_select(umb_range.w);
    let how = umb_queries[at + 1u];
    let share = umb_trilinear(umb_range.z, UmbReceiver(q.x, q.y, q.z, bitcast<vec2<i32>>(how.xy)), how.w, how.z);
    if share.missing != UMB_NO_PAGE {
        atomicAdd(&umb_feedback[1], 1u);
    }
    umb_queries[at].w = umb_share_state(share);
}
