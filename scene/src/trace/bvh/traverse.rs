//! The walk through a [`WideTree`], whatever its leaves are.

use super::{
    kernel::Kernel,
    slabs::Slabs,
    wide::{Child, WIDTH, WideTree},
};

/// What happens at a leaf.
pub(crate) trait Visitor {
    /// Visits a leaf; what is entered after `limit` need not be visited any more. True ends the walk.
    fn leaf(&mut self, leaf: usize, limit: &mut f32) -> bool;
}

/// Stack entries for the deepest tree there may be: what is left of every node on the way down.
const STACK: usize = super::binary::MAX_DEPTH * (WIDTH - 1) + 1;

#[derive(Clone, Copy)]
struct Entry {
    child: Child,
    enter: f32,
}

/// Visits the leaves that a ray meets, the nearest first if `SORTED`. Returns whether the visitor ended it.
#[inline(always)]
pub(crate) fn walk<const SORTED: bool, K: Kernel>(
    kernel: K,
    tree: &WideTree,
    slabs: &Slabs,
    mut limit: f32,
    visitor: &mut impl Visitor,
) -> bool {
    let ray = kernel.boxes(slabs);
    let mut stack = [const { std::mem::MaybeUninit::<Entry>::uninit() }; STACK];
    let mut height = 0;
    let mut current = Child::node(0);
    loop {
        while !current.is_leaf() {
            let node = &tree.nodes[current.index()];
            let (mut met, enter) = kernel.enter(&ray, node, limit);
            if met == 0 {
                match pop(&stack, &mut height, limit) {
                    Some(next) => current = next,
                    None => return false,
                }
                continue;
            }
            let mut nearest = take(&mut met);
            current = node.children[nearest];
            let base = height;
            while met != 0 {
                let slot = take(&mut met);
                let mut entry = Entry {
                    child: node.children[slot],
                    enter: enter[slot],
                };
                if SORTED && enter[slot] < enter[nearest] {
                    entry = Entry {
                        child: current,
                        enter: enter[nearest],
                    };
                    nearest = slot;
                    current = node.children[slot];
                }
                // Insertion from the top keeps the farthest lowest.
                let mut place = height;
                if SORTED {
                    while place > base {
                        let below = read(&stack, place - 1);
                        if below.enter >= entry.enter {
                            break;
                        }
                        stack[place].write(below);
                        place -= 1;
                    }
                }
                stack[place].write(entry);
                height += 1;
            }
        }
        if visitor.leaf(current.index(), &mut limit) {
            return true;
        }
        match pop(&stack, &mut height, limit) {
            Some(next) => current = next,
            None => return false,
        }
    }
}

type Stack = [std::mem::MaybeUninit<Entry>; STACK];

#[inline(always)]
#[expect(
    unsafe_code,
    reason = "zeroing the stack for every ray costs more than the ray"
)]
fn read(stack: &Stack, place: usize) -> Entry {
    // SAFETY: only places below the height are read, and those have been written.
    unsafe { stack[place].assume_init() }
}

#[inline(always)]
fn pop(stack: &Stack, height: &mut usize, limit: f32) -> Option<Child> {
    while *height > 0 {
        *height -= 1;
        let entry = read(stack, *height);
        if entry.enter <= limit {
            return Some(entry.child);
        }
    }
    None
}

/// Removes the lowest bit and returns its index.
#[inline(always)]
fn take(bits: &mut u32) -> usize {
    let index = bits.trailing_zeros() as usize & (WIDTH - 1);
    *bits &= *bits - 1;
    index
}
