//! The walk through a [`WideTree`], whatever its leaves are.

use std::mem::MaybeUninit;

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
    let mut stack = Stack::new();
    let mut current = Child::node(0);
    loop {
        if current.is_leaf() {
            if visitor.leaf(current.index(), &mut limit) {
                return true;
            }
        } else {
            let node = &tree.nodes[current.index()];
            let (met, entries) = kernel.enter(&ray, node, limit);
            if met != 0 {
                current = if SORTED {
                    nearest(met, &entries, &mut stack)
                } else {
                    first(met, &entries, &mut stack)
                }
                .child();
                continue;
            }
        }
        match stack.pop(limit) {
            Some(next) => current = next,
            None => return false,
        }
    }
}

/// The nearest of the children met; the others go on the stack, the farthest lowest.
#[inline(always)]
fn nearest(mut met: u32, entries: &[Entry; WIDTH], stack: &mut Stack) -> Entry {
    let mut nearest = entries[take(&mut met)];
    if met == 0 {
        return nearest;
    }
    let mut second = entries[take(&mut met)];
    (nearest, second) = (nearest.min(second), nearest.max(second));
    if met == 0 {
        stack.push(second);
        return nearest;
    }
    let base = stack.height;
    let third = entries[take(&mut met)];
    stack.push(second.max(third));
    second = second.min(third);
    stack.push(nearest.max(second));
    nearest = nearest.min(second);
    while met != 0 {
        let next = entries[take(&mut met)];
        stack.insert(base, nearest.max(next));
        nearest = nearest.min(next);
    }
    nearest
}

/// The first of the children met in the order of the node; the others go on the stack, the last lowest.
#[inline(always)]
fn first(mut met: u32, entries: &[Entry; WIDTH], stack: &mut Stack) -> Entry {
    loop {
        let last = 31 - met.leading_zeros();
        let entry = entries[last as usize & (WIDTH - 1)];
        met ^= 1 << last;
        if met == 0 {
            return entry;
        }
        stack.push(entry);
    }
}

/// A child to visit and where the ray enters it, so that the order is that of the distances: the bits of a distance
/// of at least 0 above those of the child.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(transparent)]
pub(crate) struct Entry(u64);

impl Entry {
    #[inline(always)]
    pub(crate) fn new(child: Child, enter: f32) -> Self {
        Self(u64::from(enter.to_bits()) << 32 | u64::from(child.bits()))
    }

    #[inline(always)]
    fn child(self) -> Child {
        Child::from_bits(self.0 as u32)
    }
}

struct Stack {
    entries: [MaybeUninit<Entry>; STACK],
    height: usize,
}

#[expect(
    unsafe_code,
    reason = "zeroing and checking the stack costs every ray more than a node"
)]
impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Self {
            entries: [const { MaybeUninit::uninit() }; STACK],
            height: 0,
        }
    }

    #[inline(always)]
    fn push(&mut self, entry: Entry) {
        debug_assert!(self.height < STACK);
        // SAFETY: a walk puts at most WIDTH - 1 entries on the stack at each level of the tree, and there are at most
        // MAX_DEPTH levels: `BinaryTree::new` sees to that.
        unsafe { self.entries.get_unchecked_mut(self.height) }.write(entry);
        self.height += 1;
    }

    /// Puts an entry below those above `base` that are nearer.
    #[inline(always)]
    fn insert(&mut self, base: usize, entry: Entry) {
        self.push(entry);
        let mut place = self.height - 1;
        while place > base {
            // SAFETY: both places are below the height and have been written.
            let [below, above] =
                unsafe { self.entries.get_disjoint_unchecked_mut([place - 1, place]) };
            // SAFETY: as above.
            if unsafe { below.assume_init() } >= entry {
                break;
            }
            std::mem::swap(below, above);
            place -= 1;
        }
    }

    #[inline(always)]
    fn pop(&mut self, limit: f32) -> Option<Child> {
        let limit = Entry(u64::from(limit.to_bits()) << 32 | u64::from(u32::MAX));
        while self.height > 0 {
            self.height -= 1;
            // SAFETY: what is below the height has been written.
            let entry = unsafe { self.entries.get_unchecked(self.height).assume_init() };
            if entry <= limit {
                return Some(entry.child());
            }
        }
        None
    }
}

/// Removes the lowest bit and returns its index.
#[inline(always)]
fn take(bits: &mut u32) -> usize {
    let index = bits.trailing_zeros() as usize & (WIDTH - 1);
    *bits &= *bits - 1;
    index
}
