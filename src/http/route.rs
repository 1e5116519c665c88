//! A route, which cannot be written down without what it needs of who calls it.

use std::collections::HashMap;
use std::sync::Arc;

use axum::Router;
use axum::handler::Handler;
use axum::http::Method;
use axum::routing::{MethodFilter, MethodRouter};

use super::AppState;
use super::gate::Need;

/// A path, and for each of its methods a need and a handler.
#[derive(Debug)]
pub(super) struct Route {
    path: &'static str,
    methods: MethodRouter<Arc<AppState>>,
    needs: Vec<(Method, Need)>,
}

/// A route without methods so far.
pub(super) fn at(path: &'static str) -> Route {
    Route { path, methods: MethodRouter::new(), needs: Vec::new() }
}

impl Route {
    pub(super) fn get<H, T>(self, need: Need, handler: H) -> Self
    where
        H: Handler<T, Arc<AppState>>,
        T: 'static,
    {
        self.on(Method::GET, MethodFilter::GET, need, handler)
    }

    pub(super) fn post<H, T>(self, need: Need, handler: H) -> Self
    where
        H: Handler<T, Arc<AppState>>,
        T: 'static,
    {
        self.on(Method::POST, MethodFilter::POST, need, handler)
    }

    pub(super) fn patch<H, T>(self, need: Need, handler: H) -> Self
    where
        H: Handler<T, Arc<AppState>>,
        T: 'static,
    {
        self.on(Method::PATCH, MethodFilter::PATCH, need, handler)
    }

    pub(super) fn delete<H, T>(self, need: Need, handler: H) -> Self
    where
        H: Handler<T, Arc<AppState>>,
        T: 'static,
    {
        self.on(Method::DELETE, MethodFilter::DELETE, need, handler)
    }

    fn on<H, T>(mut self, method: Method, filter: MethodFilter, need: Need, handler: H) -> Self
    where
        H: Handler<T, Arc<AppState>>,
        T: 'static,
    {
        self.methods = self.methods.on(filter, handler);
        self.needs.push((method, need));
        self
    }

    /// Path, methods and needs.
    pub(super) fn needs(&self) -> impl Iterator<Item = (&'static str, &Method, Need)> {
        self.needs.iter().map(|(method, need)| (self.path, method, *need))
    }
}

/// What each route needs.
#[derive(Debug, Default)]
pub(super) struct Needs(HashMap<&'static str, Vec<(Method, Need)>>);

impl Needs {
    /// What a request of this method needs at the route of this path. What no route answers needs a key: who has none is not
    /// told what there is, but where everything is open.
    pub(super) fn of(&self, path: &str, method: &Method) -> Need {
        let method = if method == Method::HEAD { &Method::GET } else { method };
        let methods = self.0.get(path).map_or(&[][..], Vec::as_slice);
        let open = !methods.is_empty() && methods.iter().all(|&(_, need)| need == Need::Nothing);
        let else_needed = if open { Need::Nothing } else { Need::AnyKey };
        methods.iter().find(|(own, _)| own == method).map_or(else_needed, |&(_, need)| need)
    }
}

/// A router of these routes, and what they need.
pub(super) fn router(routes: Vec<Route>) -> (Router<Arc<AppState>>, Needs) {
    let (mut router, mut needs) = (Router::new(), Needs::default());
    for Route { path, methods, needs: own } in routes {
        router = router.route(path, methods);
        needs.0.insert(path, own);
    }
    (router, needs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::Scope;

    #[test]
    fn what_no_route_answers_needs_a_key_and_head_what_get_does() {
        let route = at("/a").get(Need::Nothing, async || "").post(Need::May(Scope::Train), async || "");
        let open = at("/open").get(Need::Nothing, async || "");
        let (_, needs) = router(vec![route, open]);
        assert_eq!(needs.of("/a", &Method::GET), Need::Nothing);
        assert_eq!(needs.of("/a", &Method::HEAD), Need::Nothing);
        assert_eq!(needs.of("/a", &Method::POST), Need::May(Scope::Train));
        assert_eq!(needs.of("/a", &Method::PUT), Need::AnyKey);
        assert_eq!(needs.of("/b", &Method::GET), Need::AnyKey);
        assert_eq!(needs.of("/open", &Method::PUT), Need::Nothing);
    }
}
