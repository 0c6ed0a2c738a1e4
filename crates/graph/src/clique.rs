//! Largest cliques by branch and bound over bit sets (San Segundo, Rodriguez-Losada, Jimenez 2011, "An exact bit-parallel
//! algorithm for the maximum clique problem"): a candidate set that needs `k` colours adds at most `k` members.

/// What the search found.
pub(crate) struct Clique {
    /// Ascending.
    pub(crate) members: Vec<usize>,
    /// The largest clique found among the others, ascending.
    pub(crate) rivals: Vec<usize>,
    /// Whether the search for the members was not cut short.
    pub(crate) exhausted: bool,
}

/// The largest set of `nodes` all of which agree, and the largest among the rest.
pub(crate) fn largest_clique(nodes: &[usize], agree: impl Fn(&usize, &usize) -> bool, max_branches: usize) -> Clique {
    let neighbours = neighbours_of(nodes, agree);
    let mut all = Bits::new(nodes.len());
    (0..nodes.len()).for_each(|v| all.insert(v));
    let (members, exhausted) = search(&neighbours, all.clone(), max_branches);
    members.iter().for_each(|&v| all.remove(v));
    let (rivals, _) = search(&neighbours, all, max_branches);
    let named = |places: Vec<usize>| {
        let mut named: Vec<usize> = places.into_iter().map(|v| nodes[v]).collect();
        named.sort_unstable();
        named
    };
    Clique { members: named(members), rivals: named(rivals), exhausted }
}

fn neighbours_of(nodes: &[usize], agree: impl Fn(&usize, &usize) -> bool) -> Vec<Bits> {
    let mut neighbours = vec![Bits::new(nodes.len()); nodes.len()];
    for a in 0..nodes.len() {
        for b in 0..a {
            if agree(&nodes[a], &nodes[b]) {
                neighbours[a].insert(b);
                neighbours[b].insert(a);
            }
        }
    }
    neighbours
}

/// Candidates of one branch, those with the largest bound last.
struct Branch {
    candidates: Bits,
    /// Candidate and how many colours it and those before it need.
    order: Vec<(usize, usize)>,
}

impl Branch {
    fn new(neighbours: &[Bits], candidates: Bits) -> Self {
        let order = coloured(neighbours, &candidates);
        Self { candidates, order }
    }
}

/// The largest clique within some candidates, and whether it is certain to be that.
fn search(neighbours: &[Bits], candidates: Bits, max_branches: usize) -> (Vec<usize>, bool) {
    let mut best: Vec<usize> = greedy(neighbours, &candidates);
    let mut current = Vec::new();
    let mut stack = vec![Branch::new(neighbours, candidates)];
    let mut branches = 0;
    while let Some(branch) = stack.last_mut() {
        let next = branch.order.pop().filter(|(_, bound)| current.len() + bound > best.len());
        let Some((v, _)) = next else {
            stack.pop();
            current.pop();
            continue;
        };
        if branches == max_branches {
            return (best, false);
        }
        branches += 1;
        let inner = branch.candidates.and(&neighbours[v]);
        branch.candidates.remove(v);
        current.push(v);
        if current.len() > best.len() {
            best.clone_from(&current);
        }
        stack.push(Branch::new(neighbours, inner));
    }
    (best, true)
}

/// A clique to begin with: again and again the candidate that agrees with most others.
fn greedy(neighbours: &[Bits], candidates: &Bits) -> Vec<usize> {
    let (mut rest, mut members) = (candidates.clone(), Vec::new());
    loop {
        let agreeing = |&v: &usize| (rest.and(&neighbours[v]).count(), std::cmp::Reverse(v));
        let Some(v) = rest.iter().max_by_key(agreeing) else { return members };
        members.push(v);
        rest = rest.and(&neighbours[v]);
    }
}

/// Candidates colour by colour, no two of a colour agreeing.
fn coloured(neighbours: &[Bits], candidates: &Bits) -> Vec<(usize, usize)> {
    let (mut rest, mut order, mut colour) = (candidates.clone(), Vec::new(), 0);
    while !rest.is_empty() {
        colour += 1;
        let mut class = rest.clone();
        while let Some(v) = class.first() {
            class.remove(v);
            rest.remove(v);
            class.remove_all(&neighbours[v]);
            order.push((v, colour));
        }
    }
    order
}

/// A set of small numbers.
#[derive(Debug, Clone)]
struct Bits(Vec<u64>);

impl Bits {
    fn new(size: usize) -> Self {
        Self(vec![0; size.div_ceil(64)])
    }

    fn insert(&mut self, v: usize) {
        self.0[v / 64] |= 1 << (v % 64);
    }

    fn remove(&mut self, v: usize) {
        self.0[v / 64] &= !(1 << (v % 64));
    }

    fn remove_all(&mut self, others: &Self) {
        self.0.iter_mut().zip(&others.0).for_each(|(word, other)| *word &= !other);
    }

    fn and(&self, others: &Self) -> Self {
        Self(self.0.iter().zip(&others.0).map(|(a, b)| a & b).collect())
    }

    fn count(&self) -> u32 {
        self.0.iter().map(|word| word.count_ones()).sum()
    }

    fn is_empty(&self) -> bool {
        self.0.iter().all(|word| *word == 0)
    }

    fn first(&self) -> Option<usize> {
        let at = self.0.iter().position(|word| *word != 0)?;
        Some(64 * at + self.0[at].trailing_zeros() as usize)
    }

    fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        let bits = |(at, &word): (usize, &u64)| (0..64).filter(move |k| word >> k & 1 == 1).map(move |k| 64 * at + k);
        self.0.iter().enumerate().flat_map(bits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute_force(count: usize, agree: impl Fn(usize, usize) -> bool) -> usize {
        let is_clique = |set: &u32| {
            let members: Vec<usize> = (0..count).filter(|v| set >> v & 1 == 1).collect();
            members.iter().all(|&a| members.iter().all(|&b| a == b || agree(a, b)))
        };
        (0..1_u32 << count).filter(is_clique).map(|set| set.count_ones() as usize).max().unwrap_or(0)
    }

    proptest! {
        #[test]
        fn no_clique_is_larger(count in 0..11_usize, links in prop::collection::vec(any::<bool>(), 121)) {
            let agree = |a: usize, b: usize| links[11 * a.max(b) + a.min(b)];
            let nodes: Vec<usize> = (0..count).collect();
            let found = largest_clique(&nodes, |&a, &b| agree(a, b), usize::MAX);
            prop_assert!(found.exhausted);
            prop_assert_eq!(found.members.len(), brute_force(count, agree));
            let all_agree = found.members.iter().all(|&a| found.members.iter().all(|&b| a == b || agree(a, b)));
            prop_assert!(all_agree);
        }
    }

    #[test]
    fn a_search_cut_short_still_answers() {
        let nodes: Vec<usize> = (0..200).collect();
        let found = largest_clique(&nodes, |a, b| (a * a * 31 + b * b * 17 + a * b) % 101 > 25, 10);
        assert!(!found.exhausted && found.members.len() > 3);
    }
}
